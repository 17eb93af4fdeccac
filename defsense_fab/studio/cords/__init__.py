"""The mode in which the user draws cords and sees their expected error."""
