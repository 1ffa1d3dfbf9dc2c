"""How a campaign is flown: steps, chunks, refinement, sinks, single cases, rare events."""
