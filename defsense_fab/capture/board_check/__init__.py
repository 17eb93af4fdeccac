"""Find faults of a device's wiring from short readings: at rest, while wires move, in poses."""
