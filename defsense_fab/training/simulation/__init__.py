"""What the simulation says of a device, for training and for checking."""
