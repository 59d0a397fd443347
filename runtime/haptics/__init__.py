"""Advice on its way to the rider: the glove's bridge, one voice, tones, text. Begin with `teller.py`."""
