"""Episodes on a cluster are those of one machine."""

from __future__ import annotations

import pickle
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from policies import SAMPLE, noisy_copy
from published import POLICIES, needs_policies
from regress_runs import yaml_suite

from humanoid_sim.errors import InputError
from humanoid_sim.regress.cluster import RayExecutor, pack_arena, unpack_arena
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.runner import prepare_contest
from humanoid_sim.regress.subject import load_subject, suite_robot
from humanoid_sim.regress.suite_file import load_suite


def test_an_arena_that_travelled_gives_the_same_episodes(tmp_path: Path) -> None:
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    contest = prepare_contest(suite, folder, suite_robot(suite, folder, None))
    policy = noisy_copy(SAMPLE, tmp_path / "noisy.onnx", 0.05)
    arena = contest.arenas(load_subject(policy, None, contest.description, suite))[1]
    parcel = pickle.loads(pickle.dumps(pack_arena(suite, arena)))
    policy.unlink()
    there, travelled = unpack_arena(parcel)
    assert there == suite
    assert run_episodes(there, travelled, [2, 0], contest.disturbance) == run_episodes(
        suite, arena, [2, 0], contest.disturbance
    )
    assert unpack_arena(parcel)[1] is travelled


@needs_policies
def test_tensors_beside_the_model_travel_too() -> None:
    suite, folder = load_suite("velocity")
    robot = POLICIES / "models" / "unitree_g1" / "scene.xml"
    policy = POLICIES / "unitree_g1_velocity_v0" / "exported" / "policy.onnx"
    description = suite_robot(suite, folder, str(robot))
    contest = prepare_contest(suite, folder, description)
    subject = load_subject(policy, None, description, suite)
    arena = contest.arenas(subject)[0]
    parcel = pack_arena(suite, arena)
    assert parcel.external is not None
    assert unpack_arena(parcel)[1].subject.policy.batching == subject.policy.batching


def test_a_cluster_that_is_not_there() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(InputError, match=f"--ray: is '{address}', and nobody answers there: "):
            RayExecutor(address)


@pytest.mark.slow
def test_two_workers_of_a_local_ray_give_the_same_file(tmp_path: Path) -> None:
    """In processes of their own: Ray leaves threads behind, and takes its time."""
    yaml_suite(tmp_path)

    def regress(output: str, *options: str) -> bytes:
        command = [sys.executable, "-m", "humanoid_sim.regress", str(SAMPLE), "--suite", "suite.yaml", "--quiet"]
        subprocess.run([*command, "--json", output, *options], cwd=tmp_path, check=True, timeout=300)
        return (tmp_path / output).read_bytes()

    assert regress("cluster.json", "--ray", "local", "--threads", "2") == regress("one.json")
