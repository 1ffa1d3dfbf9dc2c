"""Analyses of the case table of a campaign (a row per case): statistics, requirements, sensitivity.
The only libraries imported are numpy, scipy and pandas."""
