"""The chair's decisions of each tick, from a goal or a joystick to the twist that is sent.

Begin with `navigator` (which way to drive), `supervisor` (whether the computer drives), `collision_monitor` and
`limiter`.
"""
