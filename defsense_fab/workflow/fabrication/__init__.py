"""Prepare fabrication: plates to print, moulds and silicone, and advice for the printer."""
