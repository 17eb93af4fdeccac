"""Parts that are too long for a printer's bed, in pieces."""
