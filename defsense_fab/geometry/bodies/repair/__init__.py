"""Triangles made into one closed surface that does not pass through itself."""
