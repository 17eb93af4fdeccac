"""Parameter studies of a device, the number of cords it needs, and proposed poses."""
