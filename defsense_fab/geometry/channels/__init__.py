"""Make channels for cords and wires in the body, with their ends."""
