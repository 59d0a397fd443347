"""From a path over cells to a line of poses that the chair can follow without stopping."""
