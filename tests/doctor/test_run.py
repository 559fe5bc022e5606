"""`python -m humanoid_sim.policy doctor` on the sample policy of the Lite arms."""

import json
import subprocess
import sys

import pytest
import yaml

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.doctor import run
from humanoid_sim.doctor.hypotheses import same_contract, singles
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.policy_tools import main as policy

CHECKPOINT = str(SAMPLE_POLICY)


def main(words):
    return policy(["doctor", *words])


QUICK = ("--robot", "lite", "--motion", "wave", "--seconds", "1")


@pytest.fixture
def wrong(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("override: {terms: {joint_pos: {relative: false}}}\n")
    return str(path)


def test_a_wrong_contract_is_diagnosed_and_what_it_says_to_write_cures_it(wrong, tmp_path, capsys, monkeypatch):
    assert main([CHECKPOINT, *QUICK, "--contract", wrong, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    first = document["ranking"][0]
    assert first["cause"] == "joint_pos relative"
    assert "joint_pos" in document["conclusion"]
    cure = tmp_path / "cure.yaml"
    cure.write_text(yaml.safe_dump({"override": first["override"]}))
    assert same_contract(read_contract(SAMPLE_POLICY, cure), read_contract(SAMPLE_POLICY))
    monkeypatch.setattr(run, "singles", lambda *known: singles(*known)[:5])  # all of them are a slow test
    assert main([CHECKPOINT, *QUICK, "--contract", str(cure)]) == 0
    assert "Nothing wrong found in this space" in capsys.readouterr().out


def test_ctrl_c_shows_what_is_known(monkeypatch, capsys):
    def impatient(examined, trial, ranking, progress):
        def stop(done, total):
            if done == 3:
                raise KeyboardInterrupt

        whole(examined, trial, ranking, stop)

    whole = run.search
    monkeypatch.setattr(run, "search", impatient)
    assert main([CHECKPOINT, *QUICK, "--json"]) == 130
    document = json.loads(capsys.readouterr().out)
    assert document["complete"] is False
    assert len(document["ranking"]) >= 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--seconds", "0"), "--seconds: is 0.0"),
        (("--seconds", "nan"), "--seconds: is nan"),
        (("--top", "0"), "--top: is 0"),
        (("--command", "0.5,0,0"), "--command: is '0.5,0,0', but"),
        (("--motion", "nowhere"), "--motion: unknown motion 'nowhere'"),
        (("--robot", "nobody"), "unknown robot 'nobody'"),
    ],
)
def test_bad_options_are_one_line(options, message):
    others = [("--robot", "lite"), ("--motion", "wave")]
    with pytest.raises(InputError) as error:
        main([CHECKPOINT, *(word for pair in others if pair[0] not in options for word in pair), *options])
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom humanoid_sim.policy_tools import main\n"
        "try:\n    main(['doctor', '--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'mujoco', 'onnxruntime', 'onnx'} & set(sys.modules)))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.splitlines()[-1] == "[]"
    assert "--command" in answer.stdout
