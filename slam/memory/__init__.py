"""Short-term, working and long-term memory of places, as in RTAB-Map. Begin with `memory_manager.py`."""
