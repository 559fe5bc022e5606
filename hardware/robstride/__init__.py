"""The Robstride family: its private CAN protocol, and the host's end of it.

`codec` has pure functions between frames and typed messages, for both ends of the bus; `motor_table` hears the motors
and `requests` asks them; `identification` and `enabling` lead to a motor that executes commands; `session` is what the
adapter does with a robot's motors.

Sources: the manuals of 2026-04-28 (RS00 to RS06), the vendor's samples and Actuator-Control (commit d74dd3f). Where
they disagree, the docstrings say which one is followed.
"""
