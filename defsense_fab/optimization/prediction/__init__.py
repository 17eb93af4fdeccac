"""Predict what layouts sense, choose one to build, and preview designs while they change."""
