"""ROS 2's topics over DDS without ROS, by Cyclone DDS: the domain, message types, writers and readers of CDR bytes.

Needs the extra `dds`; nothing is imported before a `Participant` is made.
"""
