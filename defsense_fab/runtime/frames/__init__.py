"""A sample of the read-out board, and what it says of the device."""
