"""Fits from measurements to models of one chair, data to data. Begin with `fit_dac.py`."""
