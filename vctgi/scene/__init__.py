"""What is read off a Mitsuba scene: triangles, materials, lights and surfaces."""
