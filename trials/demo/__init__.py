"""The demo: a rider maps a floor by joystick, then the chair drives by itself; begin with `demo.py`."""
