"""Results of experiments: numbers, kept values, pictures and the page."""
