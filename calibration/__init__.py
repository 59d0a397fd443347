"""Models of one chair: its body, its wheels and its joystick volts, as data and as fits."""
