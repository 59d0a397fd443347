"""Speed as medians and ratios against plain baselines (`make bench`). Begin with `dstar_lite.py`."""
