"""Several chairs in one building: paths for many agents at once, and the order in which chairs go.

Begin with `solving.py`.
"""
