"""Several chairs in one building: chairs that drive by the coordinator's order, the paper's tables, the proven optimum."""
