"""A single emulated motor without a bus, and robots small enough for quick tests."""

from dataclasses import dataclass, field

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Reaction, Sensed
from humanoid_sim.hardware.emulation.firmware import MotorIdentity, MotorState, RobstrideFirmware
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import decode_reply, encode_command
from humanoid_sim.hardware.robstride.firmware import firmware_of, parse_version
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, pack_value, unpack_value
from humanoid_sim.robots.motors import MOTORS

ID = 11
HOST = 0xFD


def identity(model: str = "rs-02", version: str | None = None) -> MotorIdentity:
    motor = MOTORS[model]
    number = parse_version(version or f"0.{model[-1]}.3.9")
    quirks = firmware_of(motor, number)
    return MotorIdentity(quirks.applied_to(motor), bytes(range(8)), number, quirks)


@dataclass
class Motor:
    """A motor whose sensors the test sets, and that answers in messages."""

    identity: MotorIdentity = field(default_factory=identity)
    sensed: Sensed = field(default_factory=lambda: Sensed(0.0))
    time: float = 0.0
    state: MotorState = field(init=False)

    def __post_init__(self) -> None:
        self.firmware = RobstrideFirmware(self.identity, ID)
        self.state = self.firmware.power_on(None, self.sensed)

    def feel(self, **changes: object) -> None:
        self.sensed = self.sensed._replace(**changes)  # type: ignore[arg-type]

    def tell(self, command: messages.Command) -> list[messages.Reply]:
        frame = encode_command(command, self.identity.model)
        return self._take(self.receive(frame, self.time))

    def receive(self, frame: Frame, time: float = 0.0) -> Reaction[MotorState]:
        """What the firmware makes of a frame; the motor's state stays."""
        return self.firmware.receive(self.state, frame, self.sensed, time)

    def wait(self, duration: float) -> list[messages.Reply]:
        """Let the firmware look after itself every ms."""
        replies = []
        for _ in range(round(duration / 0.001)):
            self.time += 0.001
            replies += self._take(self.firmware.advance(self.state, self.sensed, self.time))
        return replies

    def status(self, command: messages.Command) -> messages.Status:
        (reply,) = self.tell(command)
        assert isinstance(reply, messages.Status)
        return reply

    def mit(
        self, position: float = 0.0, stiffness: float = 0.0, damping: float = 0.0, effort: float = 0.0
    ) -> messages.Status:
        return self.status(messages.OperationControl(self.state.can_id, position, 0.0, effort, stiffness, damping))

    def write(self, name: str, value: float) -> messages.Status:
        parameter = PARAMETERS[name]
        payload = pack_value(parameter.type, value)
        return self.status(messages.WriteParameter(self.state.can_id, parameter.index, payload))

    def read(self, name: str) -> float:
        parameter = PARAMETERS[name]
        (reply,) = self.tell(messages.ReadParameter(self.state.can_id, parameter.index))
        assert isinstance(reply, messages.ParameterReply)
        assert reply.is_success
        assert reply.index == parameter.index
        return unpack_value(parameter.type, reply.payload)

    def cycle_power(self) -> None:
        self.state = self.firmware.power_on(self.state, self.sensed)

    def _take(self, reaction: Reaction[MotorState]) -> list[messages.Reply]:
        self.state = reaction.state
        models = dict.fromkeys(range(1, 128), self.identity.model)
        replies = []
        for frame in reaction.frames:
            reply = decode_reply(frame, models, self.state.host_id)
            assert not isinstance(reply, messages.Ignored | messages.Malformed)
            replies.append(reply)
        return replies


def fault_reports(replies: list[messages.Reply]) -> list[messages.FaultReport]:
    return [reply for reply in replies if isinstance(reply, messages.FaultReport)]
