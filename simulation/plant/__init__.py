"""Chairs: joystick volts in, motion and encoder counts out, kinematic or MuJoCo. Begin with `plant.py`."""
