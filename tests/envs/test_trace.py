"""A trace of the environment is one that `policy stamp` takes."""

from humanoid_sim.assets import WALKING_POLICY
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.envs.trace import record_trace
from humanoid_sim.policy_tools.stamp import stamp


def test_a_checkpoint_is_stamped_with_a_run_of_its_environment(tmp_path):
    scenario = make_scenario(WALKING_POLICY, "lite_biped")
    trace, output = tmp_path / "trace.npz", tmp_path / "stamped.onnx"
    policy = scenario.policy
    assert record_trace(scenario, lambda observation: policy(observation[0], 0)[None], trace, steps=20) == 20
    samples = stamp(WALKING_POLICY, output, description=scenario.description, trace=trace)
    assert samples.name == "trace.npz"
    assert abs(samples.arrays["observation"][:, 6:9]).max() > 0.1, "it walks: a zero command would show no scale"
