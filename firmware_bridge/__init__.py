"""From wheel speeds to joystick lines: the only code that reaches the motors.

It holds the bridge on the computer and the firmware of the board. Begin with README.md, then `bridge.py`.
"""
