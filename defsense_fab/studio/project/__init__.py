"""A device's folder that is being designed: its file, with undo, and what others do to it."""
