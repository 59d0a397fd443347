"""The least time in which a chair can drive between two poses, computed apart from the planner.

Begin in `fastest.py`. `first_way.py` searches a first way on a lattice, `gaps.py` measures the chair's exact outline
against boxes, `comfort.py` holds the limits and their closed forms.
"""
