"""Simulated devices: their displacement fields, built units, assumptions and camera placement."""
