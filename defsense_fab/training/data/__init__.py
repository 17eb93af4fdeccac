"""Datasets: what recordings hold, and what may be wrong with them."""
