"""A twin in place of a read-out board and cameras, while it is used."""
