"""The web page for riders and engineers, which calls a `ChairPort` and knows neither ROS nor algorithms.

Begin with `server.py`; the page itself is in `static/`.
"""
