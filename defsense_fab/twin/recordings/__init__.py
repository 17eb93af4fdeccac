"""Simulated training sessions of a device, and boards that replay them."""
