"""The mode in which regions are chosen and poses made by hand, their shape following."""
