"""Studies of a device: number of cords, proposed poses."""
