"""waychair: an electric wheelchair that maps a building, knows where it is and drives its user to a named place.

Reading order: `types` (the nouns), `slam.mapper` (one scan), `control.navigator` (one tick), `runtime.chair` (the
whole chair, one tick). The core needs no ROS; nothing heavy is imported here.
"""

__version__ = "0.1.0"
