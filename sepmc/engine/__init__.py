"""Running of kernels: compiling their Python source, caching the machine code, calling it, or
running the source as plain Python."""

from sepmc.engine.numba_settings import check

check()  # before the import of Numba, which fails on settings it cannot use
