"""From a scene file to what never changes in a run: geometry, kinematic trees, masses, materials."""
