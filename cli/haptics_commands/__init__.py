"""The commands for a driver without sight: vibrations, speech and their fitting."""
