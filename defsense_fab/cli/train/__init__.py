"""Commands that make models of recordings, and simulated recordings."""
