"""Mapping by colour and depth alone. Begin with `rgbd_mapper.py`."""
