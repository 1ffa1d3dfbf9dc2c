"""Helpers of tests and measurements: small runs, comparisons and problems of known answer."""
