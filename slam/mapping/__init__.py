"""The mapper: key scans, loop closures by scans and by pictures, checkpoints; and live mapping, which adds depth and grid.
Begin with `mapper.py`, then `live_mapping.py`."""
