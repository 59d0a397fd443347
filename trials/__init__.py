"""Whole drives of a chair in a simulator, for the commands of `waychair`.

Begin with `drive.py`, which runs the complete chair in a simulator, and `demo.py`, which maps a floor and drives on it.
"""
