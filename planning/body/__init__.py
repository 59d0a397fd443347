"""The chair's footprint, and the policies of clearance and personal space. Begin with `clearance.py`."""
