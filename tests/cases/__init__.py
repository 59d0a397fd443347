"""Circumstances of public bug reports, rebuilt: one file a kind."""
