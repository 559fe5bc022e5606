"""From DDS to a session: commands for REMOTE, safety statuses and live inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import monotonic

from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.controllers.contract import LiveTopic
from humanoid_sim.controllers.terms import USUAL_TOPICS
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.ros2.cdr import CdrError, decode
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Received
from humanoid_sim.ros2.definitions import MIT_COMMAND
from humanoid_sim.ros2.messages import SESSION_FRAME, decode_float32_array, decode_safety_status
from humanoid_sim.ros2.topics import COMMAND_TOPIC, LIVE_INPUT, SAFETY_TOPIC, Topic, topic_kind
from humanoid_sim.session.sources import remote_problem
from humanoid_sim.stack import recorded_contracts

_SUSPENDED = 0.05  # s between two polls beyond which the process was suspended
_SETTLE = 0.1  # s for which commands are dropped after that: what lay in sockets meanwhile is old
_REPEAT = 0.05  # s between two reports of a source, unless it has just ceased to be OK: a flood costs no more
_MOST_WRITERS = 16  # whose commands are kept apart
_DEPTH = 1024  # samples that may come between two polls: a flood pushes nobody else's command out


def read_command(message: bytes, joints: tuple[str, ...]) -> MITCommand:
    """Return the command in a message, shape (n,); its stamp is the sender's clock, which means nothing here.

    Raises `FieldError` or `CdrError` if it is none for this robot.
    """
    _, _, names, *fields = decode(MIT_COMMAND, message)
    command = MITCommand(*fields)
    problem = remote_problem(names, command, joints)
    if problem:
        raise FieldError(problem)
    return command


class StatusForwarder:
    """Forwards safety statuses: a fault at once, everything else at most twenty times a second."""

    def __init__(self, intake: Intake) -> None:
        self._intake = intake
        self._waiting: dict[str, list[SafetyStatus]] = {}
        """By source: the newest status, and before an OK the fault that it ends and that must still damp."""
        self._reported: dict[str, tuple[bool, float]] = {}
        """By source: whether the session has it as OK, and when that was reported, s."""

    def take(self, frame: str, status: SafetyStatus) -> None:
        """Take a status; one that a session publishes, this one or another robot's, does not count."""
        if frame != SESSION_FRAME:
            waiting = self._waiting.setdefault(status.source or "unnamed", [])
            waiting[:] = [fault for fault in waiting if status.is_ok and not fault.is_ok] + [status]

    def flush(self, stamp: int, now: float) -> None:
        """Report what is due; `stamp`, ns, is when the newest arrived, `now` in s."""
        for name, waiting in self._waiting.items():
            was_ok, since = self._reported.get(name, (True, -math.inf))
            if not waiting or (now - since < _REPEAT and (waiting[0].is_ok or not was_ok)):
                continue
            one = waiting[0]
            try:
                self._intake.post_safety(name, int(one.level), one.message, flags=int(one.flags), stamp=stamp)
            except SessionError:  # it takes nothing at present: again with the next poll
                continue
            self._reported[name] = one.is_ok, now
            del waiting[0]


class CommandReader:
    """Forwards what programs on a network send; safety statuses and live inputs of this machine alone. For one thread.

    A sample's arrival is the time of the poll before the one that finds it: the earliest possible one.
    """

    def __init__(self, attachment: Attachment, participant: Participant, *, is_local: bool) -> None:
        self._session, self._intake = attachment.session, attachment.intake
        self._joints = attachment.header.joint_names
        self._commands = Reader(participant, COMMAND_TOPIC, _DEPTH)
        self._statuses = _readers(participant, SAFETY_TOPIC, topic_kind(SAFETY_TOPIC)) if is_local else []
        self._live: list[tuple[str, int, bool, Reader]] = []
        contract = next(iter(recorded_contracts(attachment.header)), None)
        topics = {name: LiveTopic(topic) for name, topic in USUAL_TOPICS.items()}
        topics |= {} if contract is None else contract.live_topics
        for name, width in attachment.live_inputs.items() if is_local else ():
            if topic := topics.get(name):
                kind = LIVE_INPUT._replace(latched=topic.timeout == math.inf)  # one from before the bridge counts too
                self._live += [(name, width, kind.latched, one) for one in _readers(participant, topic.name, kind)]
        self.live_topics = frozenset(reader.topic for *_, reader in self._live)
        self._safety = StatusForwarder(self._intake)
        self._intakes: dict[int, Intake] = {}
        self._polled, self._settled = monotonic_ns(), 0
        self._refused = 0.0

    def close(self) -> None:
        """Close what was opened for the writers."""
        for intake in self._intakes.values():
            intake.close()
        self._intakes.clear()

    def poll(self, timeout: float) -> None:
        """Forward what has come; waits up to `timeout` s for a command. Raises `SessionError` if the session ended."""
        self._commands.wait(timeout)
        stamp, self._polled = self._polled, monotonic_ns()
        if self._polled - stamp > 1e9 * _SUSPENDED:
            self._settled = self._polled + round(1e9 * _SETTLE)
        for sample in [sample for reader in self._statuses for sample in reader.take()]:
            try:
                self._safety.take(*decode_safety_status(sample.data))
            except CdrError as error:
                self._refuse(SAFETY_TOPIC, error)
        self._safety.flush(stamp, monotonic())
        commands = self._commands.take()
        is_settled = self._polled >= self._settled
        if is_settled:
            self._send_commands(commands, stamp)
        for name, width, is_latched, reader in self._live:
            for sample in reader.take()[-1:]:
                if is_settled or is_latched:  # a latched one counts for ever, and comes once
                    self._send_live(name, width, sample, stamp)

    def _send_commands(self, samples: Sequence[Received], stamp: int) -> None:
        """Send the newest command of each writer; the session checks it again, and who may command."""
        newest = {sample.writer: sample for sample in samples}
        for writer, sample in newest.items():
            try:
                command = read_command(sample.data, self._joints)
            except (CdrError, FieldError) as error:
                self._refuse(COMMAND_TOPIC, error)
                continue
            fields = (getattr(command, name).tolist() for name in COMMAND_FIELDS)
            self._intake_of(writer).remote(self._joints, *fields, stamp=stamp)

    def _send_live(self, name: str, width: int, sample: Received, stamp: int) -> None:
        try:
            values = decode_float32_array(sample.data)
            if len(values) != width:
                raise FieldError(f"has {len(values)} values, expected {width}")
        except (CdrError, FieldError) as error:
            self._refuse(f"live input '{name}'", error)
            return
        self._intake.live(name, values.tolist(), stamp=stamp)

    def _intake_of(self, writer: int) -> Intake:
        """Return a writer's intake: REMOTE belongs to one writer."""
        if writer not in self._intakes:
            if len(self._intakes) >= _MOST_WRITERS:
                self.close()
            self._intakes[writer] = Intake(self._session, f"dds {writer:x}")
        return self._intakes[writer]

    def _refuse(self, topic: str, problem: Exception) -> None:
        """Say why a sample is not accepted, at most once a second."""
        if monotonic() - self._refused > 1.0:
            print(f"refused: {topic}: {problem}", flush=True)
            self._refused = monotonic()


def _readers(participant: Participant, topic: str, kind: Topic) -> list[Reader]:
    """Return readers that match every writer, and of a latched topic receive what came before."""
    return [
        Reader(participant, topic, _DEPTH, kind=kind, any_writer=any_writer)
        for any_writer in ([True, False] if kind.latched else [True])
    ]
