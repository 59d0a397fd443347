"""Trials of a simulated driver without sight. Begin in `guided`."""
