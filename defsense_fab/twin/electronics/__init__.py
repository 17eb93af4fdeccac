"""Simulated cords and the read-out board that measures them."""
