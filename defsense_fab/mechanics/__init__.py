"""Finite elements: compute the displacement fields of a body in its poses."""
