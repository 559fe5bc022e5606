"""What the programs do, as functions of `humanoid_sim`."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import humanoid_sim
from humanoid_sim import Policy, Simulation, python_api, simulate
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.policy_tools import main as policy_program


def test_importing_the_package_loads_none_of_it_and_no_name_hides_a_module() -> None:
    code = (
        "import sys, types, humanoid_sim as h; print('mujoco' in sys.modules, 'onnxruntime' in sys.modules);"
        "import humanoid_sim.play, humanoid_sim.regress, humanoid_sim.policy;"
        "print(*(isinstance(getattr(h, name), types.ModuleType) for name in h.__all__))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(ran.stdout.split()) == {"False"}
    assert all(hasattr(python_api, name) for name in humanoid_sim.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'simulat'"):
        humanoid_sim.simulat  # noqa: B018


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate("lite_tracking", motion="wave", duration=np.float64(7.0))


def test_a_run_has_what_play_reports_and_every_tick_as_arrays(run: Simulation) -> None:
    assert run.passed
    assert run.problems == ()
    assert "START_LOCOMOTION requested" in run._repr_html_()
    arrays = run.recording.arrays()
    ticks = list(run.recording.ticks())
    assert arrays["position"].shape == (len(ticks), 14)
    stiffness = [tick.output.command.stiffness for tick in ticks]
    np.testing.assert_array_equal(arrays["command_stiffness"], stiffness)
    drives = arrays["mode"] == Mode.LOCOMOTION
    assert not np.isnan(arrays["action"][drives]).all(axis=1).all()
    assert np.isnan(arrays["action"][~drives]).all()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"duratin": 1}, r"simulate: unknown option 'duratin' \(did you mean 'duration'\?\)"),
        ({"pace": "later"}, "simulate: pace: is 'later', expected auto or fast or realtime"),
        ({"duration": "long"}, "simulate: duration: is 'long', expected `float"),
        ({"hardware": "can0"}, "simulate: hardware is 'can0', expected none"),
        ({"record": "none"}, r"--record: .*/none"),
        ({"policy": "nothing.onnx"}, "nothing.onnx: no such file"),
        ({"command": "0.5,0,0"}, "--command: is '0.5,0,0', but no policy of this run takes a velocity"),
    ],
)
def test_a_wrong_option_is_one_line(options: dict[str, object], line: str) -> None:
    with pytest.raises(InputError, match=line) as raised:
        simulate(**options)  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)


def test_another_thread_is_told_to_leave_runs_to_the_main_one() -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(InputError, match="called in another thread"):
        pool.submit(simulate, "lite_tracking").result()


def test_a_policy_is_what_policy_show_prints(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    policy = Policy.load("lite_tracking")
    assert policy_program(["show", "lite_tracking"]) == 0
    assert capsys.readouterr().out == str(policy)
    assert simulate(policy, script="damp; hold 0.1; damp").summary["policy"] == policy.checkpoint.source
