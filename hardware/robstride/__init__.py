"""The Robstride family: its private CAN protocol, and the host's end of it.

Sources: the manuals of 2026-04-28 (RS00 to RS06), the vendor's samples and Actuator-Control (commit d74dd3f). Where
they disagree, the docstrings say which one is followed.
"""
