"""A local page on which sliders change a campaign, and its cases run again."""
