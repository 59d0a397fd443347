"""Figures of the back ends for pose graphs, in the plane and in space. Begin with `posegraphs.py`."""
