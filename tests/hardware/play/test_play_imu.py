"""An IMU on a serial line beside emulated motors."""

import models
import pytest
from emulated_imu import EmulatedImu

from humanoid_sim.robots.description import load_robot

HARDWARE = ("--hardware", "virtual:imu", "--allow-script", "--policy", "placeholder")


@pytest.fixture
def device():
    emulated = EmulatedImu()
    yield emulated
    emulated.close()


@pytest.mark.soak
def test_what_it_feels_is_the_robots_state(run, quick, device):
    device.rate = (0.1, 0.2, 0.3)
    result = run("--robot", quick, *HARDWARE, "--imu", f"microstrain:{device.port}", "--script", "hold 0.2")
    assert result.status == 0
    for tick in result.ticks:
        assert tick.input.state.imu_angular_velocity == pytest.approx([0.1, -0.2, -0.3])
        assert [status.source for status in tick.input.safety] == ["humanoid_devices_robstride/virtual:imu", "imu"]


def test_a_policy_that_observes_one_is_refused_without(run, quick, folder, calibrate):
    lite = load_robot("lite")
    names = lite.joint_names
    contract = models.contract(
        joint_names=names,
        action_joint_names=names,
        joint_stiffness=50.0,
        joint_damping=2.0,
        default_joint_pos=0.0,
        action_scale=0.5,
        observation=("projected_gravity", "imu_ang_vel"),
    )
    models.saved(folder / "feels.onnx", models.linear_model(models.write_metadata(contract), inputs=6, outputs=14))
    calibrate()
    result = run("--robot", quick, "--hardware", "can0", "--policy", "feels.onnx", record=False)
    assert result.status == 2
    assert result.err == "error: --imu: is none, but the policy observes projected_gravity, imu_ang_vel\n"
