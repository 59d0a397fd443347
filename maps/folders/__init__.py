"""A map on disk, with everything beside `map.yaml`. Begin with `map_files.py`."""
