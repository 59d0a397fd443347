"""Drives that a mapper is scored by, and the scores."""
