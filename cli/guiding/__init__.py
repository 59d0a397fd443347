"""The command for a driver who is led by touch."""
