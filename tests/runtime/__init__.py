"""Tests of `defsense_fab.runtime`."""
