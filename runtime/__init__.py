"""The running chair: localiser, pilot and drive base put together, its black box, and mapping with its reports.

Begin with `chair.py` for a chair that drives, and with `mapping.py` for a recording that becomes a map.
"""
