"""The figures by name, each with its bar. Begin with `evaluation/__main__.py`, which lists them."""
