"""Statistics, requirements and sensitivity from the rows of a campaign (numpy, scipy and pandas
only)."""
