"""Conversion between waychair's types and ROS messages: `sensors`, `camera`, `motion`, `maps`, `chair` and `reports`.

Begin with `wire.py`, which converts messages to bytes and back.
"""
