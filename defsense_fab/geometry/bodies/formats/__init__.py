"""Readers of mesh files, one module for each format or group of formats."""
