"""Advice for a driver without sight by touch, speech, tones and text: symbols, patterns, limits, advice.

Begin with `symbols.py`, then `patterns.py` with its data in `patterns.yaml`, and `advice.py`, which decides when a symbol is
sent.
"""
