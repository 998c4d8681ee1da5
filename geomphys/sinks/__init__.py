"""Where results go: memory, MCAP, rerun."""
