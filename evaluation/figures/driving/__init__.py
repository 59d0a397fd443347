"""Figures of planning and driving. Begin with `scenes.py`."""
