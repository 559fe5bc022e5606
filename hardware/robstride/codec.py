"""Both directions of both ends: what the rest of the package imports."""

from humanoid_sim.hardware.robstride.commands import decode_command, encode_command
from humanoid_sim.hardware.robstride.operation_control import OperationControlEncoder
from humanoid_sim.hardware.robstride.replies import decode_reply, encode_reply

__all__ = ["OperationControlEncoder", "decode_command", "decode_reply", "encode_command", "encode_reply"]
