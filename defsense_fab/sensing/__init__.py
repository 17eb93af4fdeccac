"""Cords as they are built into a device, their signals, and the read-out board's serial frames."""
