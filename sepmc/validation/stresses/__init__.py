"""Hard inputs of `sepmc stress`, by what makes them hard."""
