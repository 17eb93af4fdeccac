"""Experiments with devices: their layouts, units and pictures."""
