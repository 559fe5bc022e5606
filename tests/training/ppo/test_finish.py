"""What is told while a policy is measured, and what Ctrl-C does then."""

from humanoid_sim.training.ppo import run
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.run import measure


def test_measuring_is_announced_and_may_be_left_out(tmp_path, monkeypatch, capsys):
    asked = []

    def regress(config):
        asked.append(config)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return 0

    monkeypatch.setattr(run, "regress", regress)
    subject, policy = subject_of(TrainConfig(robot="lite_biped")), tmp_path / "policy.onnx"
    assert measure(subject, policy, tmp_path)
    line = "measuring with the suite velocity: 96 episodes; Ctrl-C leaves it out\n"
    assert capsys.readouterr().err == line
    assert (asked[0].suite, asked[0].robot, asked[0].policies) == ("velocity", "lite_biped", (str(policy),))
    assert not measure(subject, policy, tmp_path)
    assert capsys.readouterr().err == f"{line}regress: left out; {policy} is whole\n"


def test_a_task_without_a_suite_is_not_measured(tmp_path, capsys):
    subject = subject_of(TrainConfig(task="balance"))
    assert measure(subject, tmp_path / "policy.onnx", tmp_path)
    assert capsys.readouterr().err == "regress: no suite ships for the task balance\n"
