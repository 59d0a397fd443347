"""From a wanted twist to wheel speeds: limits, closed loop and watches over it. Begin with `limiter.py`."""
