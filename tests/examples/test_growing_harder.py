"""The example, as anybody would run it, for two updates."""

from pathlib import Path

import pytest
from script_files import load_script

EXAMPLE = Path(__file__).parents[2] / "examples" / "growing_harder.py"


@pytest.fixture
def example():
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed (rl)")
    return load_script(EXAMPLE)


@pytest.mark.slow
def test_it_learns_on_robots_and_ground_that_grow_harder(example, tmp_path, monkeypatch, capsys):
    assert example.harder(0.0) == {"commands": 0.3, "randomisation": 0.0, "push": 0.0, "terrain": 0.0}
    assert example.harder(1.0) == {"commands": 1.0, "randomisation": 1.0, "push": 1.0, "terrain": 1.0}
    seen = []

    class Watch(example.Progress):
        def _on_rollout_start(self):
            super()._on_rollout_start()
            seen.extend(self.training_env.get_attr("progress", 0))

    output = tmp_path / "network.zip"
    monkeypatch.setattr(example, "Progress", Watch)
    assert example.main(["--steps", "384", "--envs", "8", "--output", str(output)]) == 0
    assert seen == [0.0, 0.5]
    assert "384" in capsys.readouterr().out
    assert output.stat().st_size > 10_000
