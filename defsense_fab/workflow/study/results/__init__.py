"""What came of a study: table, Pareto front, sensitivities, page."""
