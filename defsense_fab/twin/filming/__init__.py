"""Simulated cameras: kinds of cameras, and the images that they take of a scene."""
