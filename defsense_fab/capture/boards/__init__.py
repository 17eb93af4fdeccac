"""Firmware of read-out boards: the images that come with the package, and how they are written."""
