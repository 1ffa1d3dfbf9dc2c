"""Entry point of ``python -m sepmc``: runs the command line, as ``sepmc`` does."""

from sepmc.cli.app import main

main()
