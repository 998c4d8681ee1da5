"""What never changes in a run: scene, models, pieces, masses."""
