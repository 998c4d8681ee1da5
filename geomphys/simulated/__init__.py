"""The simulated loop: impulses and resting contact."""
