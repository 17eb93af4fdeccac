"""One device that is being edited: its project, its build, and background work."""
