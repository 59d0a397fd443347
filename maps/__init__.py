"""What the world is: occupancy grid, distance field, map files, named places."""
