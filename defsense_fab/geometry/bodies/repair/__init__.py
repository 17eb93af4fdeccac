"""Repair triangles to one closed surface that does not pass through itself."""
