"""A gamepad for a running session: buttons ask for modes, sticks command a velocity."""
