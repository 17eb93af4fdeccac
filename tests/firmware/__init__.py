"""Tests of the compiled firmware."""
