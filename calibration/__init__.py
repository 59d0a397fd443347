"""Models of one chair: its body, wheels, sensor mounts and joystick volts, as data, as fits and as drives.

Begin with `chair_body`, `calibration_file` (a chair's file) and `fits/fitted_dac` (the joystick lines' model).
"""
