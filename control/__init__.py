"""What decides each tick: navigator, supervisor, limiter, kinematics."""
