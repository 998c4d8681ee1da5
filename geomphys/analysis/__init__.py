"""Checks, statistics, comparisons and plots of results."""
