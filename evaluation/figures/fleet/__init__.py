"""Figures about several chairs in one building."""
