"""Readers of file formats of other programs: thrust curves, aerodynamic decks, soundings, mass
properties, trajectories, telemetry; and writers of result tables."""
