"""Journeys over several storeys in simulation. Begin with `journeys.py`; `journey_runs.py` counts many of them."""
