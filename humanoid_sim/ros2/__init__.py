"""ROS 2 without ROS: its wire format, its message definitions, and the MCAP files that hold them."""
