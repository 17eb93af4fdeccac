"""A device live: its model and build, the loop from samples to outputs, the view."""
