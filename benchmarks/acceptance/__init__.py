"""The acceptance figures: `make acceptance [NAME]` writes out/acceptance/NAME.json. Begin with `__main__.py`."""
