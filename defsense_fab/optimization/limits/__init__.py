"""Limits of a layout: walls, radii, clearances and parts that can be printed."""
