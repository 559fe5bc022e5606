"""Episodes on a cluster are those of one machine."""

import socket

import pytest
from policies import SAMPLE, noisy_copy
from regress_runs import yaml_suite

from humanoid_sim.errors import InputError
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.executors import parcel_of, ray_executor, run_task
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite


def test_a_policy_that_travelled_gives_the_same_episodes(tmp_path):
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    policy = prepare_policy(prepare_suite(suite, folder), noisy_copy(SAMPLE, tmp_path / "noisy.onnx", 0.05))
    travelled = run_task(parcel_of(policy), 1, [2, 0])
    assert travelled == run_episodes(policy.cases[1], [2, 0], suite.disturbance)


def test_a_cluster_that_is_not_there():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        with (
            pytest.raises(InputError, match=f"--ray: is '{address}', and nobody answers there: "),
            ray_executor(address),
        ):
            pass
