"""Files that users edit: their keys are declared once, and all else follows from there."""
