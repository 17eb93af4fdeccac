"""A built device's guide, followed literally by hands that know only what lies where."""
