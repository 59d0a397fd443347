"""The parts of the navigator node: drives, displays, and journeys over the storeys of a building."""
