"""The graph of a storey, made from its map, and made again without losing records that people changed. Begin with `storey_generation.py`."""
