"""Pure functions of numbers: cones, directions and hashes."""
