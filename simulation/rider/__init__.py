"""Simulated riders who cannot see: skin, hand and driver. Begin in `blind_driver`."""
