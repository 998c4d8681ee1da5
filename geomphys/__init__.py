"""Geometry-driven contact for recorded motion capture."""
