"""What the figures about several chairs compare with: the paper's tables and the proven optimum."""
