"""``python -m sepmc``."""

from sepmc.cli import main

main()
