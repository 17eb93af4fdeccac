"""Datasets of recorded sessions, training, evaluation, and their pages."""
