"""What flies a written kernel: compiled pieces and their cache, the prange door, plain Python."""
