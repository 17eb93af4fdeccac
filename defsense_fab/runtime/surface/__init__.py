"""Solve the moving surface of the device from its markers, in real time."""
