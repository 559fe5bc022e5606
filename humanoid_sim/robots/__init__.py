"""Robots: descriptions, MJCF and URDF files, motor models, and the interface to the control loop."""
