"""waychair: an electric wheelchair that maps a building, localises in it and drives its user to a named place.

Reading order: `types` (the message types), `slam.mapping.mapper` (one scan), `control.drive.navigator` (one tick),
`runtime.chair` (the whole chair, one tick). The core does not need ROS. This module imports nothing heavy.
"""

__version__ = "0.2.0"
