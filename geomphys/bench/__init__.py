"""How fast it is: recorded experiments, scaling curves, and other engines on the same input in the same run."""
