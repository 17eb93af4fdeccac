"""Tests of `defsense_fab.optimization`."""
