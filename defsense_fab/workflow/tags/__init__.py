"""Camera tags of a device: where they go, and sheets to print."""
