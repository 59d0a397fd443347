"""From wheel speeds to joystick lines: the only code that touches what moves the motors."""
