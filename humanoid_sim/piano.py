"""`python -m humanoid_sim.piano`: how well songs are played, recorded or not, and which keys a robot reaches."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import tyro

from humanoid_sim.cli import ExitStatus, run_program
from humanoid_sim.command_line import Commands, parse
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.evaluation.piano_score import PlayedKeys, score
from humanoid_sim.mit import KEY_PRESSED

if TYPE_CHECKING:
    from PIL.Image import Image

    from humanoid_sim.evaluation.piano_run import PlayedSong

_UNSEEN = 8
"""Songs that no training has seen, in the table unless others are named."""


@dataclass(frozen=True)
class Score:
    """Score a recording: which keys were down against those that the song asks for.

    Per time step as RoboPianist defines precision, recall and F1, and per note: a stroke counts if it begins within
    --onset-tolerance of a note of its key.
    """

    recording: tyro.conf.Positional[Path]
    """A recording (.mcap) in which a piano policy ran, or live keys were played while one ran."""
    song: tyro.conf.Positional[Path | None] = None
    """Goals (.mcap) to score it by. Default: the song that the recording holds."""
    onset_tolerance: float = 0.1
    """Seconds between a note's start and the stroke that plays it."""
    picture: Path | None = None
    """PNG to draw: what was hit, missed and wrong over time."""
    json: bool = False
    """Print the result as JSON."""
    overwrite: bool = False
    """Replace the picture if it exists."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("run.mcap --picture roll.png", "figures, and what was hit and missed"),
    )


@dataclass(frozen=True)
class Reach:
    """Compute which keys each hand of a robot reaches: over the key and on it, within limits, touching nothing else."""

    robot: str = "lite_piano"
    """A shipped robot with a piano, or the path of a robot's YAML file."""
    picture: Path | None = None
    """PNG to draw: the keyboard, in the colours of the hands."""
    json: bool = False
    """Print the result as JSON."""
    overwrite: bool = False
    """Replace the picture if it exists."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("--robot lite_piano --picture reach.png", "the keys of each hand, and a picture"),
    )


@dataclass(frozen=True)
class Table:
    """Play songs with a policy, and open loop through the same gains, as fast as it goes; one row a song.

    Exit status 1 if the policy touches a key harder than the robot's limit, or anything but a hand touches anything.
    """

    songs: tyro.conf.Positional[tuple[str, ...]] = ()
    """Sample songs ({songs}), MIDI files, or random:N, songs that no training has seen. Default: all sample songs, and
    eight that no training has seen."""
    policy: str | None = None
    """ONNX checkpoint, or a shipped policy ({policies}). Default: the one for the robot."""
    robot: str = "lite_piano"
    """A shipped robot with a piano, or the path of a robot's YAML file."""
    actuation: Literal["qfrc_applied", "affine", "implicit"] = "qfrc_applied"
    """qfrc_applied is the reference; implicit is faster, and looks for touches and contacts less often."""
    json: bool = False
    """Print everything as JSON."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("twinkle random:0", "two songs, by policy and open loop"),
        ("--policy mine.onnx", "the sample songs, and eight that no training has seen"),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `piano` with command-line arguments; returns the exit status."""
    commands = Commands(
        "Score how a song was played; measure a policy on songs; see which keys a robot reaches.",
        {"score": Score, "table": Table, "reach": Reach},
    )
    options: Score | Table | Reach = parse(commands, "piano", arguments)
    match options:
        case Score():
            return _score(options)
        case Table():
            return _table(options)
        case Reach():
            return _reach(options)


def _score(options: Score) -> int:
    from humanoid_sim.files import output_file  # noqa: PLC0415 - heavy imports stay out of `--help`

    if not 0.0 < options.onset_tolerance < 10.0:
        raise InputError(f"--onset-tolerance: is {options.onset_tolerance}, expected seconds above 0 and below 10")
    if options.picture is not None:
        output_file(options.picture, "--picture", ".png", overwrite=options.overwrite)
    played = read_performance(options.recording, options.song)
    result = score(played.pressed, played.wanted, played.step, onset_tolerance=options.onset_tolerance)
    if options.json:
        print(json.dumps(asdict(result), indent=1))
    else:
        print("                precision  recall     F1")
        for name, ratio in (("per time step", result.steps), ("per note", result.notes)):
            print(f"{name:<15} {ratio.precision:9.3f} {ratio.recall:7.3f} {ratio.f1:6.3f}")
        print(
            f"{result.hit_count} of {result.note_count} notes were struck in time; {result.false_count} wrong strokes"
        )
    if options.picture is not None:
        from humanoid_sim.rendering.piano_roll import draw_piano_roll  # noqa: PLC0415

        title = f"{options.recording.name}: F1 {result.steps.f1:.3f}"
        _write(draw_piano_roll(played.wanted, played.step, played.pressed, title), options.picture)
    return 0


def _table(options: Table) -> int:
    from humanoid_sim.assets import policy_path, sample_policy, sample_songs  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.cli import complain  # noqa: PLC0415
    from humanoid_sim.envs.scenario import make_scenario  # noqa: PLC0415
    from humanoid_sim.evaluation.piano_player import PianoPlayer  # noqa: PLC0415
    from humanoid_sim.evaluation.piano_run import play_open_loop, play_with_policy  # noqa: PLC0415
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415
    from humanoid_sim.policy.random_songs import named_song  # noqa: PLC0415
    from humanoid_sim.policy.song import song_motion  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    robot = load_robot(options.robot)
    if robot.piano is None:
        raise InputError(f"--robot: '{robot.name}' has no piano, expected a robot with one, such as lite_piano")
    path = sample_policy(robot.name) if options.policy is None else policy_path(options.policy)
    checkpoint = load_checkpoint(path, None, robot.joint_names)
    contract = checkpoint.contract
    if contract.task_type != "piano":
        raise InputError(f"--policy: {path} is a policy for task_type {contract.task_type}, expected one for piano")
    names = options.songs or (*sample_songs(), *(f"random:{i}" for i in range(_UNSEEN)))
    motions = {name: song_motion(named_song(name, robot), contract.policy_dt, robot) for name in names}
    player = PianoPlayer(robot, contract.policy_dt)
    rows: dict[str, tuple[PlayedSong, PlayedSong]] = {}
    for name, motion in motions.items():
        complain(f"{name}: {len(motion.frames) * contract.policy_dt:.1f} s")
        scenario = make_scenario(checkpoint, robot, motion, actuation=options.actuation)
        wiring, table = scenario.wiring, motion.frames
        rows[name] = (
            play_with_policy(scenario.description, wiring, scenario.policy, table, options.actuation),
            play_open_loop(robot, player, table, contract.policy_dt, options.actuation),
        )
    problems = [
        f"{name}: {problem}"
        for name, (by_policy, _) in rows.items()
        for problem in by_policy.problems(robot.piano.key_force_limit)
    ]
    if options.json:
        document = {name: {"policy": asdict(one), "open_loop": asdict(other)} for name, (one, other) in rows.items()}
        print(json.dumps({"actuation": options.actuation, "songs": document, "problems": problems}, indent=1))
    else:
        _print_table(rows)
        print("".join(f"\n{problem}" for problem in problems) or "\nnothing was touched that should not be")
    return ExitStatus.of(not problems)


def _print_table(rows: Mapping[str, tuple[PlayedSong, PlayedSong]]) -> None:
    """As Markdown: the documentation has it from here."""
    print(
        "| song | precision | recall | F1 | hardest touch, N | open loop: precision | recall | F1 | hardest touch, N |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    figures = {name: [value for run in pair for value in run.figures] for name, pair in rows.items()}
    groups = {
        "mean of the sample songs": [row for name, row in figures.items() if not name.startswith("random:")],
        "mean of the unseen songs": [row for name, row in figures.items() if name.startswith("random:")],
    }
    for group, chosen in groups.items():
        if len(chosen) > 1:
            means = [sum(column) / len(chosen) for column in zip(*chosen, strict=True)]
            means[3::4] = [max(column) for column in list(zip(*chosen, strict=True))[3::4]]
            figures[group.replace("mean", "mean, and hardest touch,")] = means
    for name, row in figures.items():
        shown = [f"{value:.1f}" if i % 4 == 3 else f"{value:.3f}" for i, value in enumerate(row)]
        print(f"| {name} | {' | '.join(shown)} |")


def _reach(options: Reach) -> int:
    from humanoid_sim.files import output_file  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.policy.song import key_name  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415
    from humanoid_sim.simulation.fingers import HANDS, Fingers  # noqa: PLC0415

    if options.picture is not None:
        output_file(options.picture, "--picture", ".png", overwrite=options.overwrite)
    robot = load_robot(options.robot)
    fingers = Fingers(robot)
    reached = {name: sorted(fingers.reachable(hand)) for hand, name in enumerate(HANDS)}
    if options.json:
        print(json.dumps({"robot": robot.name, "reach": reached}))
    else:
        for name, keys in reached.items():
            span = f"{key_name(keys[0])} to {key_name(keys[-1])}, keys {keys[0]} to {keys[-1]}" if keys else "none"
            print(f"{name:<6} {span}")
        described = [list(keys) for keys in fingers.settings.hands]
        if described != list(reached.values()):
            print(f"{robot.name}: piano.reach is {[[keys[0], keys[-1]] for keys in described]}, which differs")
    if options.picture is not None:
        from humanoid_sim.rendering.piano_roll import draw_reach  # noqa: PLC0415

        _write(draw_reach(fingers.keys, list(reached.values()), f"{robot.name}: keys within reach"), options.picture)
    return 0


def _write(picture: Image, path: Path) -> None:
    from humanoid_sim.files import whole_file  # noqa: PLC0415

    drawn = BytesIO()
    picture.save(drawn, "PNG")
    with whole_file(path) as file:
        file.write(drawn.getvalue())
    print(f"wrote {path}", file=sys.stderr)


def read_performance(recording: Path, song: Path | None = None) -> PlayedKeys:
    """Return the keys of a recording, and those that its song asks for.

    Raises `InputError` if there is no policy's step, no keys or no song in it, or their numbers differ.

    Args:
        song: the goals, in place of those in the recording.
    """
    from humanoid_sim.policy.motion import MOTION_ATTACHMENT, parse_motion, read_motion  # noqa: PLC0415 - heavy
    from humanoid_sim.recording.reader import open_recording  # noqa: PLC0415

    run = open_recording(recording).of_last_policy()
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
