"""Loss of a robot, its distance from what it should do, and the closed loop in which both are seen."""
