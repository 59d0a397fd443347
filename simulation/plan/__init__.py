"""Floor plans as YAML files and the worlds built from them. Begin with `world.py`."""
