"""The simulator: worlds, chairs, people and sensors, which send the same messages as a real chair.

Begin with `simulator.py`, then `plan/world.py` for the buildings and `plant/plant.py` for the chairs.
"""
