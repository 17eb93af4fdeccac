"""Candidate cords and the layouts selected from them."""
