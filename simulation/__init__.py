"""Worlds, plant and sensors that speak the same messages as a real chair."""
