"""Editing a building: drafts, operations on them as data, and the log that keeps a draft. Begin with `operations.py`."""
