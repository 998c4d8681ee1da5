"""Sinks for results, provenance and summary, and reading an output back."""
