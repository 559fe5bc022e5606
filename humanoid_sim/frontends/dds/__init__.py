"""The DDS bridge: a session's topics for ROS 2 and Cyclone DDS, and commands for REMOTE from there."""
