"""A first scene file for a log, and convex pieces to look at."""
