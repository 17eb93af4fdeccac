"""The mode that cuts the body: its stretch in a section, and where another cord would help."""
