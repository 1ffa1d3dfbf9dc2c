"""What a scene needs of a kernel: structure, events, parameters, tables, methods."""
