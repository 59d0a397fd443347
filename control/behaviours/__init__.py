"""Behaviour cells and networks, which perceive for a driver who cannot see. Begin with `cell.py`, then `paper.py`."""
