"""The local page of `sepmc studio`: sliders change a campaign, and its cases are run again."""
