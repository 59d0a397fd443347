"""What a page shows of a running chair, and what it may ask of it; begin with `chair_port.py`."""
