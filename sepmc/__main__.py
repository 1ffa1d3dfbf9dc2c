"""``python -m sepmc``."""

from sepmc.cli.app import main

main()
