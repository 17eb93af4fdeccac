"""The device that is not there yet: cords, specimens and boards that behave like real ones."""
