"""Parts on a printer's bed."""
