"""The commands for several chairs in one building."""
