"""The example, as anybody would run it, for two updates."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed (rl)")

EXAMPLE = Path(__file__).parents[2] / "examples" / "growing_harder.py"


@pytest.mark.slow
def test_it_learns_on_robots_and_ground_that_grow_harder(tmp_path: Path) -> None:
    output = tmp_path / "network.zip"
    command = [sys.executable, str(EXAMPLE), "--steps", "384", "--envs", "8", "--output", str(output)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"total_timesteps +\| 384", done.stdout)
    assert output.stat().st_size > 10_000


@pytest.mark.slow
def test_its_curriculum_begins_with_nothing_and_ends_with_all() -> None:
    sys.path.insert(0, str(EXAMPLE.parent))
    try:
        import growing_harder  # noqa: PLC0415 - on the path as of here
    finally:
        sys.path.remove(str(EXAMPLE.parent))
    assert growing_harder.harder(0.0) == {"commands": 0.3, "randomisation": 0.0, "push": 0.0, "terrain": 0.0}
    assert growing_harder.harder(1.0) == {"commands": 1.0, "randomisation": 1.0, "push": 1.0, "terrain": 1.0}
    envs = growing_harder.make_envs(2, "mixed")
    model = growing_harder.PPO("MlpPolicy", growing_harder.StableBaselinesVecEnv(envs), n_steps=4, batch_size=8)
    seen = []

    class Watch(growing_harder.Progress):  # type: ignore[name-defined, misc]
        def _on_rollout_start(self) -> None:
            super()._on_rollout_start()
            seen.append(envs.unwrapped.progress)

    model.learn(32, callback=Watch())
    assert seen == [0.0, 0.25, 0.5, 0.75]
    envs.close()
