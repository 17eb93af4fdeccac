"""Channels in the body: of cords, of wires, and their ends."""
