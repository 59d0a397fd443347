"""The command line of `waychair`: one file per group of commands, each a thin layer over a function of another room.

Begin with `main.py`, which lists the commands; their modules are imported only when they run.
"""
