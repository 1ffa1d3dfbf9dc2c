"""Campaigns: the Python interface, definition and sampling of cases, execution and run folders."""
