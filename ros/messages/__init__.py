"""Nouns as ROS messages and back: `wire` (bytes), `sensors`, `camera`, `motion`, `maps` and `reports`."""
