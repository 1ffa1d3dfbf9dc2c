"""Scene to plan: what a kernel must know, as arrays."""
