"""The commands `defsense calibrate ...`."""
