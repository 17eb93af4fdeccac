"""Descents from a selected layout to the best one found."""
