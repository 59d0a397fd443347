"""Figures of the board, the calibration, the simulator and the nodes. Begin with `bridge.py`."""
