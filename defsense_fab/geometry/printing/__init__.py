"""Arrange parts on a printer's bed and write them to files."""
