"""Send live frames to other programs and devices, each by an output with the same interface."""
