"""Models: trained, used on readings that are there, and run live."""
