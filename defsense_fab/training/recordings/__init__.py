"""Datasets of sessions, and of files of others."""
