"""The commands for buildings of several storeys, and journeys in them."""
