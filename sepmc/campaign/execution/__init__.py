"""Execution of campaigns: steps, chunks, refinement, sinks, single cases, rare events."""
