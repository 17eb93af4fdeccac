"""The steps of a build, what is up to date, and the report."""
