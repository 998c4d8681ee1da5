"""The published method, as a baseline: discrete checks, global penetration depth, cyclic coordinate descent."""
