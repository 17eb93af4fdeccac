"""Boundary conditions, loads and poses, and what they leave free."""
