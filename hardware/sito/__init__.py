"""The Sito family (TA40-50, TA40-100): its CAN protocol, and the host's end of it.

`codec` has pure functions between frames and typed messages, for both ends of the bus, and what encodes commands.

Source: Actuator-Control (T-K-233 and Berkeley-Humanoids, commit d74dd3f), `src/protocol/sito.rs` and `src/sito.rs`.
There is no public manual: what that library does not use (feedback 0 and 3, fault codes, a timeout in the motor, a
torque limit) is not known here.
"""
