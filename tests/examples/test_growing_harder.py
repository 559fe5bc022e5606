"""The example, as anybody would run it, for two updates."""

import importlib.util
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "growing_harder.py"


@pytest.fixture
def example(monkeypatch):
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed (rl)")
    spec = importlib.util.spec_from_file_location("growing_harder", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # where its options' types and texts are looked up
    spec.loader.exec_module(module)
    return module


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
