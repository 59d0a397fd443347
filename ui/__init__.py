"""The rider's and engineer's page; it speaks to a ChairPort and knows neither ROS nor algorithms."""
