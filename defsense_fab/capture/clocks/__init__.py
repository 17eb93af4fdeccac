"""Clocks of board and cameras: fits, LED, motion, frame times."""
