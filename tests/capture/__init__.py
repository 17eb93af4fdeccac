"""Tests of `defsense_fab.capture`."""
