"""Buildings from the files of other programs, and back. Begin with `exchange.py`."""
