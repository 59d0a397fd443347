"""Routes through a whole building by border tables, and the searches they are compared with. Begin with `hierarchical.py`."""
