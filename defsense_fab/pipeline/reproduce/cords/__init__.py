"""Experiments with cords alone."""
