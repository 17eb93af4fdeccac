"""Make moulds in which parts are cast."""
