"""Random scenes flown the way a campaign flies them, each row held against an independent flight of
its case."""
