"""The commands `defsense board ...`."""
