"""Hard inputs of `sepmc stress`, by the cause of difficulty."""
