"""Simulated riders without sight: skin, hand and driver. Begin in `blind_driver`; `lone_driver` is told nothing."""
