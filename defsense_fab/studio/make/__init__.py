"""The mode that builds the device: its parts, their assembly, and the lists of materials."""
