"""`python -m humanoid_sim.piano`: how well a recorded song was played."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.piano_score import PlayedKeys
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, parse_motion, read_motion
from humanoid_sim.recording.reader import open_recording


@dataclass(frozen=True)
class PianoConfig:
    """Score a recording: precision, recall and F1 of each time step, of the keys that were down against the song's."""

    recording: tyro.conf.Positional[Path]
    """A recording (.mcap) in which a piano policy ran, or live keys were played while one ran."""
    song: tyro.conf.Positional[Path | None] = None
    """Goals (.mcap) to score it by. Default: the song that the recording holds."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `piano` with command-line arguments; returns the exit status."""
    options = parse(PianoConfig, "piano", arguments)
    score = read_performance(options.recording, options.song)
    if options.json:
        print(json.dumps(score, indent=1))
    else:
        print("precision {precision:.3f}, recall {recall:.3f}, F1 {f1:.3f}".format(**score))
    return 0


def read_performance(recording: Path, song: Path | None = None) -> dict[str, float]:
    """Return precision, recall and F1 of a recording by its song, or by another `song`.

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
    played = PlayedKeys(motion.frames)
    with blaming(recording):
        for tick in run.ticks():
            step, keys = tick.output.policy_step, tick.input.state.extern.get(KEY_PRESSED)
            if step is not None and keys is not None:
                played.update(step.frame, keys.value)
    score = played.score()
    if score is None:
        raise InputError(f"{recording}: has no policy step with live keys, expected a run of a piano policy")
    return score


if __name__ == "__main__":
    sys.exit(run_program(main))
