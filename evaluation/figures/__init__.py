"""The figures by name, each with its bar. `evaluation/__main__.py` lists them."""
