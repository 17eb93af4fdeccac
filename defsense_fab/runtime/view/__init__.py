"""Show the moving device on a page in the browser."""
