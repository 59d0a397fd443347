"""The recording of what a chair heard and did, and the explanation of its stops. Begin with `recorder.py`."""
