"""Calibration of cameras, from recorded and live views of a board."""
