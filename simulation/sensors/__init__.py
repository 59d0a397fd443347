"""Lidar, camera, IMU and sonars, with the rays and the renderer behind them. Begin with `lidar.py`."""
