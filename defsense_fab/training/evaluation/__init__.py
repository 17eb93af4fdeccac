"""Evaluations of trained models on sessions: tables, figures, their page."""
