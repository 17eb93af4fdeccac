"""Capture sessions: recording a device with cameras, and what was recorded."""
