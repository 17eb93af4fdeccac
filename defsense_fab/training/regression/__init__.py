"""Ridge regression of many pictures, and what decoders are fitted to."""
