"""Whole scenes: a Chair in a Simulator, run, scored and reported."""
