"""The simulator: worlds, chairs, people and sensors, which send the same messages as a real chair.

Begin with `simulator.py`, then `world.py` for the buildings and `plant.py` for the chairs.
"""
