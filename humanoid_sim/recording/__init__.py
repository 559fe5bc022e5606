"""Recordings: what every tick saw and decided, in one MCAP file that ROS 2 tools open and `replay` repeats."""
