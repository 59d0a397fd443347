"""ROS bags without ROS: reading, salvage of damaged files, and writing that survives a full disk. Begin with
`rosbag_reader.py`."""
