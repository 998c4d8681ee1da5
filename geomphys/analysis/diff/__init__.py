"""Compares two outputs channel by channel; reports as a record, an HTML page or a rerun overlay."""
