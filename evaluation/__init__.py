"""Scenes, runs and figures that measure the product; it is not in the wheel. Begin with `__main__.py`, which lists every
figure by name."""
