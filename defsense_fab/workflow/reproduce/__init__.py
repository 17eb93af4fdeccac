"""Experiments that reproduce the paper's results with the twin."""
