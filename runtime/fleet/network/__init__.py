"""The network between chairs: its seam, Zenoh behind it, its keys, and the process of a peer."""
