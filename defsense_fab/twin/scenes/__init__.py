"""What stands before the twin's cameras: printed tags on a device that moves."""
