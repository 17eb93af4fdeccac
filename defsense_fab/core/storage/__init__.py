"""Files: written whole, locked, named for every system, read strictly."""
