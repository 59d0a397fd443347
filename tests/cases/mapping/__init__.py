"""Recordings and maps with the faults that people met."""
