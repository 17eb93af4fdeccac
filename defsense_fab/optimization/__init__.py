"""Candidate curves, selection, refinement and constraints."""
