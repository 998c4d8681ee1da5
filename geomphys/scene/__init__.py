"""From a scene file to the constant data of a run: geometry, kinematic trees, masses, materials."""
