"""The ROS 2 nodes: convert, call the core, convert, publish. Begin with `node.py`.

`parts` holds the work that a node leaves to a class of its own.
"""
