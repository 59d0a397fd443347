"""Many recordings become map folders at once, on one computer or a cluster. Begin with `many_maps.py`."""
