"""The parts of the page node: its port, and what it hears from the other nodes; begin with `page_port.py`."""
