"""Scales of the network's inputs and output, shared by the network (`student.py`) and its graph (`export.py`)."""

__all__ = ["ACTION", "CHANGE", "CORRECTION", "ELBOW_JOINTS", "LARGEST_LEAD", "LEAD", "LENGTH", "TRACKING", "VELOCITY"]

ACTION = 0.5
"""rad per unit of action, all joints: actions are of order one over the whole workspace."""

ELBOW_JOINTS = 4
"""Joints before the elbow's body: shoulder pitch, roll, yaw and the elbow itself. The other three are the wrist's."""

LENGTH = 5.0
"""1/m: an upper arm is about one unit."""

VELOCITY = 0.3
"""s/rad"""

TRACKING = 10.0
"""1/rad: the frame's joint positions less the joints': a few degrees are about one unit."""

LEAD = 5.0
"""1/rad: the last command less the joints'."""

CHANGE = 3.0
"""1/action: the last action less the frame's."""

CORRECTION = 0.3
"""action: of the feedback's output."""

LARGEST_LEAD = (0.4, 0.4, 0.4, 0.4, 0.3, 0.3, 0.3)
"""rad, per joint: how far a command may be ahead of its joint.

Where the reference jumps, K_p times this bounds the torque, and K_p / K_d times this the speed.
"""
