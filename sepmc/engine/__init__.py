"""What flies a written kernel: compiled code, how it is kept, and how it is called."""

from sepmc.engine.numba_settings import check

check()  # before Numba is imported, which fails by what it cannot use
