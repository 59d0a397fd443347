"""Pictures: features, matching, registration, visual odometry and coloured points. Begin with `features.py`."""
