"""Sources of read-out samples, and recordings of them."""
