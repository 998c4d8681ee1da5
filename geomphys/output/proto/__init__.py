"""The project's own messages."""
