"""The mapper: key scans, loop closures by scans and by pictures, checkpoints. Begin with `mapper.py`."""
