"""Run a device: load its model and build, loop from samples to outputs, and keep its files."""
