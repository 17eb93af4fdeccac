"""Tests of `defsense_fab.optimize`."""
