"""Experiments run from their description to a page: the paper's, and those of one's own."""
