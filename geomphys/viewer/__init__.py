"""Results on a screen and as pictures."""
