"""Pictures: features, matching, registration and visual odometry. Begin with `features.py`."""
