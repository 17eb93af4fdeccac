"""Calibration workflow: files of the parts to print, and the fit of the response."""
