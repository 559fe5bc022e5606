"""Suites of songs: the shipped one with its baseline, and what becomes of songs."""

import dataclasses
import json
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from humanoid_sim.assets import PIANO_POLICY, SAMPLE_POLICY, asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.piano_score import score
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.regress import main
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import Case, Disturbance, Suite, Tolerance
from humanoid_sim.simulation.batch import Randomisation

BASELINE = asset_path("suites", "lite_piano.json")
QUIET = Disturbance(Randomisation())


def suite(*cases, **changes):
    return Suite(
        name="songs",
        task="piano",
        robot="lite_piano",
        cases=cases,
        seeds=2,
        tolerances={"f1": Tolerance()},
        actuation="implicit",
        **changes,
    )


@pytest.fixture(scope="module")
def short():
    songs = suite(Case(name="five", song="five_fingers", duration=3.0))
    return prepare_policy(prepare_suite(songs, Path()), PIANO_POLICY).cases[0]


def test_an_episode_is_scored_as_a_run_is(short):
    steps = []
    (episode,) = run_episodes(short, [0], QUIET, threads=1, watch=steps)
    pressed = np.stack([step.state.extern[KEY_PRESSED].value[0] for step in steps[1:]])
    expected = score(pressed, short.motion.frames[1:151], 0.02)
    assert expected.note_count >= 2
    for name in ("precision", "recall", "f1"):
        assert episode.metrics[name] == pytest.approx(getattr(expected.steps, name))
    assert episode.metrics["note_f1"] == expected.notes.f1
    assert (episode.steps, episode.failure) == (150, "")
    force = episode.metrics["key_force"]
    assert force is not None
    assert 1.0 < force < 14.0
    assert episode.metrics["hard_touches"] == 0.0


def test_a_key_that_is_touched_too_hard_is_counted(short):
    description = short.description
    assert description.piano is not None
    gentle = replace(description, piano=replace(description.piano, key_force_limit=1.0))
    strict = prepare_suite(short.suite, Path())
    case = prepare_policy(dataclasses.replace(strict, description=gentle), PIANO_POLICY).cases[0]
    (episode,) = run_episodes(case, [0], QUIET, threads=1)
    assert episode.metrics["hard_touches"] == 1.0


def test_a_digest_knows_the_song_and_not_its_name(tmp_path):
    (tmp_path / "mine.mid").write_bytes(asset_path("songs", "twinkle.mid").read_bytes())
    digests = [
        prepare_suite(suite(Case(name="a", song=song)), tmp_path).digests["a"]
        for song in ("twinkle", "mine.mid", "repeats")
    ]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 2


@pytest.mark.parametrize(
    ("case", "robot", "policy", "message"),
    [
        (Case(name="a", song="nothing"), None, PIANO_POLICY, "case 'a': song: unknown song 'nothing'; known: black"),
        (Case(name="a", song="twinkle"), "lite", PIANO_POLICY, "robot 'lite': has no piano, a piano suite expects one"),
        (
            Case(name="a", song="twinkle"),
            None,
            SAMPLE_POLICY,
            "lite_tracking.onnx: is a policy for task_type tracking, the suite 'songs' is for one that plays songs",
        ),
    ],
)
def test_what_does_not_fit_is_one_line(case, robot, policy, message):
    with pytest.raises(InputError) as error:
        prepare_policy(prepare_suite(suite(case), Path(), robot), policy)
    assert message in str(error.value)


def test_the_baseline_is_of_the_shipped_policy():
    baseline = json.loads(BASELINE.read_bytes())
    assert baseline["sha256"] == sha256(PIANO_POLICY.read_bytes()).hexdigest()
    assert len(baseline["episodes"]) == 32
    assert not any(episode["failure"] for episode in baseline["episodes"])


@pytest.mark.soak
def test_the_shipped_policy_passes_against_it(capsys):
    arguments = ["--suite", "lite_piano", "--baseline", str(BASELINE), "--only", "ode_to_joy", "--quiet"]
    assert main([str(PIANO_POLICY), *arguments]) == 0
    assert capsys.readouterr().out.startswith("PASS lite_piano")
