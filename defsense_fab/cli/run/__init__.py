"""The command `defsense run`."""
