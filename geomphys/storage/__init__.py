"""Caches, temporary folders, and files behind URLs."""
