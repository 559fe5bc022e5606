"""Episodes on a cluster are those of one machine."""

import pickle
import socket

import pytest
from policies import SAMPLE, noisy_copy
from published import POLICIES, needs_policies
from regress_runs import yaml_suite

from humanoid_sim.errors import InputError
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.executors import RayExecutor, pack_case, unpack_case
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite


def test_a_case_that_travelled_gives_the_same_episodes(tmp_path):
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    policy = noisy_copy(SAMPLE, tmp_path / "noisy.onnx", 0.05)
    case = prepare_policy(prepare_suite(suite, folder), policy).cases[1]
    parcel = pickle.loads(pickle.dumps(pack_case(case)))
    policy.unlink()
    travelled = unpack_case(parcel)
    assert travelled.suite == suite
    assert run_episodes(travelled, [2, 0], suite.disturbance) == run_episodes(case, [2, 0], suite.disturbance)
    assert unpack_case(parcel) is travelled


@needs_policies
def test_tensors_beside_the_model_travel_too():
    suite, folder = load_suite("velocity")
    robot = POLICIES / "models" / "unitree_g1" / "scene.xml"
    policy = POLICIES / "unitree_g1_velocity_v0" / "exported" / "policy.onnx"
    case = prepare_policy(prepare_suite(suite, folder, str(robot)), policy).cases[0]
    parcel = pack_case(case)
    assert parcel.external is not None
    assert unpack_case(parcel).policy.batching == case.policy.batching


def test_a_cluster_that_is_not_there():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(InputError, match=f"--ray: is '{address}', and nobody answers there: "):
            RayExecutor(address)
