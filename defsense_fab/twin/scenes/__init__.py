"""Scenes before the cameras of the twin: a device that moves, its printed tags, and assumptions."""
