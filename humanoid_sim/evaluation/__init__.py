"""When a robot is lost, how far it is from what it should do, and the closed loop in which both are seen."""
