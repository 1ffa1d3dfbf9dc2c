"""Random scenes: campaigns generated from seeds, whose rows are compared with independent
simulations of their cases."""
