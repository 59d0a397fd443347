"""Trials of a simulated driver who cannot see. Begin in `guided`."""
