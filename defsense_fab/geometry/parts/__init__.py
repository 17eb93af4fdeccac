"""Cut the body along cord planes into printable parts, with pins and numbers, and check them."""
