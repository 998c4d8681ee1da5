"""Audits, statistics, comparisons and plots of outputs."""
