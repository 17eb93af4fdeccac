"""What the hands do, in an order in which they can."""
