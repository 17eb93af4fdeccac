"""The device that is not there yet: cords, specimens and read-out boards that behave like real
ones."""
