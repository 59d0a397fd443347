"""Journeys over several storeys: drive, call a lift, ride, find out the storey, drive on. Begin with `journey.py`."""
