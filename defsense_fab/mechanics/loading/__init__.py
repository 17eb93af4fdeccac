"""Poses as boundary conditions and loads, and the unknowns that these leave free."""
