"""Tests of `defsense_fab.mechanics`."""
