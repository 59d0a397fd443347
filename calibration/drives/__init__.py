"""Drives and recordings of a real chair, and the calibration that comes of them. Begin with `dac_and_stops.py`, which sweeps
the joystick lines, and `board_drive.py`, which holds them through the board."""
