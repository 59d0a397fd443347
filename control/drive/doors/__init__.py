"""Doorways near a drive: found in views, followed, and passed by their live jambs. Begin with `doorway_tracker.py`."""
