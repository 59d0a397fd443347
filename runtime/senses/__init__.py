"""The sensors of the behaviour cells that need a memory of their own: doorways, the camera on servos, door frames."""
