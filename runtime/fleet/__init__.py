"""A chair's part in a building that it shares with others; begin with `chain_driving.py`."""
