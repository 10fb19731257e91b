"""Voxel cone tracing for Mitsuba 3: clipmap voxels, lit by reflective shadow maps, read by cones."""
