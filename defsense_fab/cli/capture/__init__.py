"""The commands `defsense capture ...`."""
