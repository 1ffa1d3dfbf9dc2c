"""Benchmark of speed and accuracy of a scene on this machine: `bench` writes its parts into a
folder."""
