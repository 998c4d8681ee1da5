"""MCAP logs to frames."""
