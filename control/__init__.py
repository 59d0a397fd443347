"""The chair's decisions of each tick, from a goal or a joystick to the twist that is sent.

Begin with `drive/navigator.py` (which way to drive), `safety/supervisor.py` (whether the computer drives),
`safety/collision_monitor.py` and `speed/limiter.py`.
"""
