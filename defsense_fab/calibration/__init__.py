"""Calibration of cords: from resistances on bent specimens to the response to strain."""
