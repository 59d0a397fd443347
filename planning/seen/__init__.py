"""Obstacles and people that sensors see and the map lacks, and where people will be. Begin with
`obstacle_layer.py`."""
