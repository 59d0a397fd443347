"""Solid things, contacts and seeds that everything else of the simulator shares. Begin with `scene.py`."""
