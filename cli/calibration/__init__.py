"""The commands that calibrate a chair: its drive, its sensors."""
