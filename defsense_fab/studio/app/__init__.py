"""The studio of a folder as the application of a server."""
