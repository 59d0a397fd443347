"""The view of a running chair on a page, and the requests of pages; begin with `chair_port.py`."""
