"""`waychair map` and `waychair map-all`."""
