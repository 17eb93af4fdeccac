"""Workflows from a device folder to a trained model, and the Python interface to them."""
