"""ROS 2's topics over DDS without ROS, by Cyclone DDS (extra `dds`): domain, message types, writers and readers."""
