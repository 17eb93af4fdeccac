"""Clocks of read-out board and cameras: fits, LED, motion, frame times."""
