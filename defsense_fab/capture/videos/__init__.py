"""Tracks of markers from the videos of several cameras."""
