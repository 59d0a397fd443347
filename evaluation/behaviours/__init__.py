"""Checks of the behaviour cells: a plain interpreter, random networks, and the tables of the paper's rules."""
