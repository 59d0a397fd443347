"""Drives with the faults that people met."""
