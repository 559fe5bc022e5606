"""Failing episodes as recordings of whole runs, which `replay` opens.

An episode begins in LOCOMOTION, a recording in ZERO_TORQUE. So the recording has a few ticks in front in which the
robot is held where the episode starts, while the FSM is walked up through a standby that is cut down to one policy
step. From START_LOCOMOTION on, each tick is a policy step with the very state and action of the episode: the control
stack is run on them as in any session, and repeating the recording gives the same bits.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path

import msgspec

from humanoid_sim import __version__
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event, EventKind, Intent, TickInput, TickRecord
from humanoid_sim.mit import Extern, MITState
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.regress.episodes import Step, run_episodes
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Disturbance
from humanoid_sim.robots.schema import RobotDescription, StandbySettings
from humanoid_sim.stack import build_supervisor, run_header

_LONGEST_STANDBY = 100
"""Ticks within which a standby of one policy step has ended, whatever the period."""


def choose_failures(episodes: Sequence[Episode], limit: int) -> list[Episode]:
    """Return the failures to record, at most `limit`: the first of each case, then the second of each, and so on."""
    place: dict[str, int] = {}
    ranked = []
    for episode in episodes:
        if episode.failure:
            ranked.append((place.setdefault(episode.case, 0), episode))
            place[episode.case] += 1
    return [episode for _, episode in sorted(ranked, key=lambda pair: pair[0])][:limit]


def recording_name(policy: str, episode: Episode) -> str:
    """Return the file's name, without characters that a file system may refuse."""
    return re.sub(r"[^\w.+-]+", "_", f"{policy}-{episode.case}-{episode.seed}") + ".mcap"


def record_episode(path: Path, case: PreparedCase, episode: Episode, disturbance: Disturbance) -> None:
    """Run an episode again and write it as a recording, whole or not at all.

    Raises `InputError` if the file cannot be written, or the
    episode goes otherwise than when it failed.
    """
    steps: list[Step] = []
    again = run_episodes(case, [episode.seed], disturbance, threads=1, watch=steps)[0]
    if again != episode:
        # Bits agree on machines of a kind: an episode that a cluster ran may end otherwise here.
        raise InputError(
            f"--record-failures: {episode.label} goes otherwise on this machine, '{again.failure}' instead of "
            f"'{episode.failure}'; run it here to record it"
        )
    contract, suite = case.scenario.contract, case.suite
    description = _short_standby(case.scenario.description, contract.policy_dt)
    answers = (step.action[0] for step in steps if step.action is not None)  # one by one, as they were given
    loaded = load_policy(contract, lambda *_: next(answers), case.motion)
    # The episode ran without guards, and goes on where one would have ended it.
    supervisor = build_supervisor(
        description, contract.policy_dt, loaded, action_limit=suite.action_limit, guards=False
    )
    header = run_header(
        description,
        contract.policy_dt,
        loaded,
        case.motion,
        settings=_settings(case, episode),
        action_limit=suite.action_limit,
        guards=False,
    )
    temporary = path.with_name(f".{hashlib.sha256(path.name.encode()).hexdigest()[:16]}.tmp")
    recorder = McapRecorder(temporary)
    recorder.start(header)
    try:
        time = 0.0
        for record in _ticks(supervisor, steps, contract.policy_dt):
            recorder.tick(record)
            time = float(record.input.state.time)
        kind = {"lost": EventKind.FALL, "fault": EventKind.FAILURE}.get(episode.kind, EventKind.NOTE)
        recorder.event(Event(time, f"regress: {suite.name}, {episode.label}: {episode.failure}", kind))
    finally:
        recorder.close()
        if recorder.error or sys.exc_info()[0] is not None:
            temporary.unlink(missing_ok=True)
    if recorder.error:
        raise InputError(f"{path}: cannot be written: {recorder.error}")
    temporary.replace(path)


def _settings(case: PreparedCase, episode: Episode) -> dict[str, object]:
    return {
        "program": f"humanoid_sim.regress {__version__}",
        "policy": str(Path(case.checkpoint.source).resolve()),
        "policy_sha256": case.checkpoint.sha256,
        "motion": case.case.motion or case.case.song or None,
        "regress": {
            "suite": case.suite.name,
            "case": episode.case,
            "command": case.case.command,
            "seed": episode.seed,
            "failure": episode.failure,
        },
    }


def _short_standby(description: RobotDescription, period: float) -> RobotDescription:
    def short(settings: StandbySettings) -> StandbySettings:
        return msgspec.structs.replace(settings, segment_durations=(period,), pose_segments=settings.pose_segments[-1:])

    return msgspec.structs.replace(
        description,
        standby_controller_a=short(description.standby_controller_a),
        standby_controller_b=short(description.standby_controller_b),
    )


def _ticks(supervisor: Supervisor, steps: Sequence[Step], period: float) -> Iterator[TickRecord]:
    """Yield the ticks of a recording: the FSM's way up, the episode, and a last one in DAMPING."""
    memory, index = supervisor.initial(), -1

    def tick(step: Step, *intents: Intent) -> TickRecord:
        nonlocal memory, index
        index += 1
        tick_input = TickInput(_one(step.state, index * period), (), intents)
        memory, output = supervisor.step(memory, tick_input)
        return TickRecord(index, tick_input, output, 0.0, False, step.qpos[0])

    intents, ready = [Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION], True
    while intents:
        if index >= _LONGEST_STANDBY:
            raise AssertionError("the shortened standby did not end")
        # The tick of START_LOCOMOTION is the episode's first step already.
        record = tick(steps[0], *((intents.pop(0),) if ready else ()))
        yield record
        ready = record.output.standby is None or record.output.standby.is_finished
    for step in steps[1:]:
        # The last state is one in which no policy ran any more.
        yield tick(step, *((Intent.DAMP,) if step.action is None else ()))


def _one(state: MITState, time: float) -> MITState:
    """Return the only robot of a batch, on the recording's clock."""
    own = {field.name: getattr(state, field.name)[0] for field in fields(state) if field.name not in ("time", "extern")}
    live = {name: Extern(value.value[0], time, value.timeout) for name, value in state.extern.items()}
    return MITState(time=time, **own, extern=live)
