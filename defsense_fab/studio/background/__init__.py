"""Work in the background: child processes, and threads that handle the latest request."""
