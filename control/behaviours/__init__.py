"""Behaviour cells and networks, which perceive for a driver without sight. Begin with `cell.py`, then `paper.py`."""
