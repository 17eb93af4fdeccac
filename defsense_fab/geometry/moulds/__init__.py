"""Moulds in which parts are cast."""
