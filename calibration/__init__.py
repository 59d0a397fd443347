"""Models of one chair: its body, wheels, sensor mounts and joystick volts, as data and as fits.

Begin with `chair` (the body), `calibration_file` (a chair's file) and `fitted_dac` (the joystick lines' model).
"""
