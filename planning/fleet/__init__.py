"""Several chairs in one building: who drives where and when. `paper/` is the node network of the source paper."""
