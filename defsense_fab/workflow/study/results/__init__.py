"""Results of a study: table, sensitivities and page."""
