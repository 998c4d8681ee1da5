"""Sweep and prune, distance, penetration depth, manifolds. Usable alone."""
