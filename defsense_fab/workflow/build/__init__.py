"""The stages of a build, and what is up to date."""
