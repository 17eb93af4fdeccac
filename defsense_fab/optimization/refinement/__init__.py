"""Refine selected layouts by descents, and keep the best one."""
