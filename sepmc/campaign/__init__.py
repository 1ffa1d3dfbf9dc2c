"""How a campaign is flown: cases, trial cases, chunks, where they go, what they leave; the Python
interface."""
