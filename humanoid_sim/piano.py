"""`python -m humanoid_sim.piano`: how well a recorded song was played."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.piano_score import PlayedKeys, score
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, parse_motion, read_motion
from humanoid_sim.recording.reader import open_recording


@dataclass(frozen=True)
class PianoConfig:
    """Score a recording: which keys were down against those of the song, per time step and per note."""

    recording: tyro.conf.Positional[Path]
    """A recording (.mcap) in which a piano policy ran, or live keys were played while one ran."""
    song: tyro.conf.Positional[Path | None] = None
    """Goals (.mcap) to score it by. Default: the song that the recording holds."""
    onset_tolerance: float = 0.1
    """Seconds between a note's start and the stroke that plays it."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `piano` with command-line arguments; returns the exit status."""
    options = parse(PianoConfig, "piano", arguments)
    if not 0.0 < options.onset_tolerance < 10.0:
        raise InputError(f"--onset-tolerance: is {options.onset_tolerance}, expected seconds above 0 and below 10")
    played = read_performance(options.recording, options.song)
    result = score(played.pressed, played.wanted, played.step, onset_tolerance=options.onset_tolerance)
    if options.json:
        print(json.dumps(asdict(result), indent=1))
    else:
        print("                precision  recall     F1")
        for name, ratio in (("per time step", result.steps), ("per note", result.notes)):
            print(f"{name:<15} {ratio.precision:9.3f} {ratio.recall:7.3f} {ratio.f1:6.3f}")
        print(f"{result.hit_count} of {result.note_count} notes struck in time; {result.false_count} wrong strokes")
    return 0


def read_performance(recording: Path, song: Path | None = None) -> PlayedKeys:
    """Return the keys of a recording beside those of its song, or of another `song`.

    Raises `InputError` if there is no policy's step, no keys or no song in it, or their numbers differ.
    """
    run = open_recording(recording)
    if song is not None:
        motion = read_motion(song)
    elif MOTION_ATTACHMENT in run.header.attachments:
        motion = parse_motion(run.header.attachments[MOTION_ATTACHMENT], MOTION_ATTACHMENT)
    else:
        raise InputError(f"{recording}: holds no song; give one")
    if motion.task_type != "piano":
        raise InputError(f"{song or recording}: its motion is for task_type {motion.task_type}, expected a song")
    played = PlayedKeys(motion.frames, motion.policy_dt)
    with blaming(recording):
        for tick in run.ticks():
            step, keys = tick.output.policy_step, tick.input.state.extern.get(KEY_PRESSED)
            if step is not None and keys is not None:
                played.update(step.frame, keys.value)
    if not len(played.pressed):
        raise InputError(f"{recording}: has no policy step with live keys, expected a run of a piano policy")
    return played


if __name__ == "__main__":
    sys.exit(run_program(main))
