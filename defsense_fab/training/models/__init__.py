"""Models made of datasets and of simulations, kept, and corrected."""
