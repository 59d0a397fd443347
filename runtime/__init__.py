"""The parts put together as one object, the Chair, and the report of what it did."""
