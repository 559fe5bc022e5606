import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from humanoid_sim.envs.registration import ENVIRONMENTS


def printed(*lines):
    """What a Python of its own prints."""
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr == ""
    return done.stdout.splitlines()


NAMES = "print(*sorted(name for name in gymnasium.registry if name.startswith('humanoid_sim/')))"


def test_importing_the_environments_registers_them_and_the_package_imports_nothing():
    assert printed("import gymnasium, humanoid_sim.envs", NAMES) == [" ".join(sorted(ENVIRONMENTS))]
    assert printed("import sys, humanoid_sim", "print('gymnasium' in sys.modules, 'numpy' in sys.modules)") == [
        "False False"
    ]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("LiteTracking-v0", {"weights": {"effort": -0.1}, "joint_noise": 0.0}),
        ("BipedVelocity-v0", {"episode_seconds": 2.0}),
        ("Policy-v0", {"contract": "lite_tracking", "robot": "lite", "motion": "drum"}),
        ("LiteModes-v0", {"remote": True}),
    ],
)
def test_specs_are_pickled_and_written_as_json(name, options):
    env = gymnasium.make(f"humanoid_sim/{name}", **options)
    pickled = pickle.loads(pickle.dumps(env.spec))
    read = EnvSpec.from_json(env.spec.to_json())
    for spec in (pickled, read):
        again = gymnasium.make(spec)
        assert again.spec.kwargs == env.spec.kwargs
        expected, found = (one.reset(seed=3)[0] for one in (env, again))
        for key in expected if isinstance(expected, dict) else [...]:
            np.testing.assert_array_equal(found[key], expected[key])


@pytest.mark.parametrize(
    ("name", "options", "steps"),
    [
        ("LiteTracking-v0", {}, 400),
        ("LiteTracking-v0", {"task": "balance", "episode_seconds": 3.0}, 150),
        ("LiteTracking-v0", {"max_episode_steps": 30}, 30),
        ("BipedVelocity-v0", {}, 1000),
        ("BipedVelocity-v0", {"episode_seconds": 60.0}, 3000),
        ("LiteModes-v0", {}, 12000),
    ],
)
def test_specs_say_how_long_an_episode_may_be(name, options, steps):
    env = gymnasium.make(f"humanoid_sim/{name}", **options)
    assert env.spec.max_episode_steps == steps
    if "Modes" not in name:
        envs = gymnasium.make_vec(f"humanoid_sim/{name}", num_envs=2, threads=1, **options)
        assert envs.spec.max_episode_steps == steps


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space", "ignore:.*Box observation space m")
@pytest.mark.parametrize("name", ["LiteTracking-v0", "BipedVelocity-v0", "LiteModes-v0"])
def test_gymnasium_s_own_check_passes_without_a_display(name, monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    env = gymnasium.make(f"humanoid_sim/{name}").unwrapped
    assert env.metadata["render_modes"] == ["rgb_array"]
    check_env(env, skip_render_check=True)
    monkeypatch.setenv("DISPLAY", ":99")
    assert gymnasium.make(f"humanoid_sim/{name}").unwrapped.metadata["render_modes"] == ["human", "rgb_array"]
