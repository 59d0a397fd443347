"""A chair under a fleet control that speaks VDA 5050; begin with `vda5050_robot.py`."""
