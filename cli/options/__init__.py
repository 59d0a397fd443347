"""Options and helpers that several commands share. Begin with `arguments.py`."""
