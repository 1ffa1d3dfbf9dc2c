"""Running of written kernels: compiling, caching and calling."""

from sepmc.engine.numba_settings import check

check()  # before the import of Numba, which fails on settings it cannot use
