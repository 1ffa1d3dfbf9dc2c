"""Stresses of `sepmc stress`, by the cause of difficulty: each is a function that simulates hard
inputs and returns lines of the table (`sepmc.validation.stresses.line.Stress`)."""
