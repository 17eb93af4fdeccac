"""Mesh a closed surface with tetrahedra."""
