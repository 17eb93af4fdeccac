"""Cords as they are built in, and how they answer to strain."""
