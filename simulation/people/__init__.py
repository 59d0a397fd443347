"""People who walk about by the social force model. Begin with `people.py`."""
