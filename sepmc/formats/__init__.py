"""Files of the field, read to tables of a campaign: thrust curves, aerodynamic decks, soundings."""
