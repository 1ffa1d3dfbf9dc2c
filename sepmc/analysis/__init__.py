"""What a campaign's rows say: statistics, requirements, sensitivity (numpy, scipy and pandas
only)."""
