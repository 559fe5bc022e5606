"""The Robstride family: its private CAN protocol, and the host's end of it."""
