"""The mode in which the device is built: its parts, their assembly, what to cut and to buy."""
