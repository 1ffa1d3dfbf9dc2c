"""Checks of `sepmc verify`: each is a function that simulates scenes and returns lines of the table
(`sepmc.validation.line.Line`)."""
