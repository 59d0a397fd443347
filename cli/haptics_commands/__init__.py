"""The commands for a driver who cannot see: vibrations, speech and their fitting."""
