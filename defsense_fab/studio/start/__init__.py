"""The page of a folder that has no device yet."""
