"""Cameras: images, calibration, and their files."""
