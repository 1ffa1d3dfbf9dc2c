"""Benchmark of speed and accuracy of a scene on this machine (`sepmc bench`):
`sepmc.bench.bench.bench` measures its parts and writes them into a folder."""
