"""Running things by the hundred, live or replayed, and keeping the results. Begin with `kept_runs.py`."""
