import numpy as np
import pytest
from alike import hasty

from humanoid_sim.envs.modes_env import ModesEnv
from humanoid_sim.envs.spaces import INTENTS
from humanoid_sim.messages import Intent, Mode, SafetyLevel

pytestmark = pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")

LITE = {"policy": "lite_tracking", "motion": "wave"}


class Operator:
    """Drives an environment by intents, and checks every observation."""

    def __init__(self, env):
        self.env = env
        self.observation, self.info = env.reset(seed=0)
        self.reward = 0.0

    def ask(self, intent=None, ticks=1, **remote):
        """An intent in the first of some ticks; the mode after them."""
        for tick in range(ticks):
            number = INTENTS.index(intent) if tick == 0 else 0
            action = {"intent": number, "send": int(bool(remote)), **remote} if self.env.is_remote else number
            self.observation, reward, self.quit, self.truncated, self.info = self.env.step(action)
            assert self.env.observation_space.contains(self.observation)
            self.reward += reward
        return Mode(self.observation["mode"])


@pytest.fixture(scope="module")
def shared():
    env = ModesEnv(hasty(), **LITE)
    yield env
    env.close()


@pytest.fixture
def operator(shared):
    return Operator(shared)


def test_the_walk_up_and_down_again(operator):
    assert operator.info["controller"] == "zero_torque_controller"
    assert operator.ask(Intent.DAMP) is Mode.DAMPING
    assert operator.ask(Intent.LOAD_A, 23) is Mode.STANDBY
    assert operator.observation["standby_segment"] == 2
    assert 0.0 <= operator.observation["standby_progress"][0] < 0.2
    assert operator.ask(None, 28) is Mode.STANDBY
    assert operator.observation["standby_finished"] == 1
    assert operator.reward == 0.0
    assert operator.ask(Intent.START_LOCOMOTION, 40) is Mode.LOCOMOTION
    assert operator.reward == pytest.approx(0.2)  # 40 ticks of 5 ms
    assert operator.ask(Intent.DAMP) is Mode.DAMPING
    assert not operator.quit
    operator.ask(Intent.QUIT)
    assert operator.quit
    assert operator.info["time"] == pytest.approx(0.005 * (1 + 51 + 40 + 1 + 1))


def test_what_is_refused_is_said_with_its_reason(operator):
    assert operator.ask(Intent.START_LOCOMOTION) is Mode.ZERO_TORQUE
    assert operator.info["refusals"] == ("START_LOCOMOTION refused: requires finished STANDBY, mode is ZERO_TORQUE",)
    operator.ask(Intent.DAMP)
    operator.ask(Intent.LOAD_B, 60)
    operator.ask(Intent.START_REMOTE)
    assert operator.info["refusals"] == ("START_REMOTE refused: remote_policy_controller is not available",)
    operator.ask()
    assert operator.info["refusals"] == ()


def test_a_simulation_that_is_no_longer_sound_is_let_go(operator):
    operator.ask(Intent.DAMP)
    operator.ask(Intent.LOAD_A, 10)
    operator.env.robot.data.qvel[3] = np.nan
    assert operator.ask(None, 2) is Mode.ZERO_TORQUE  # DAMPING needs the position of at least one joint
    assert operator.observation["safety_level"] == SafetyLevel.CRITICAL
    assert "simulation unstable" in operator.info["status"]
    again = Operator(operator.env)
    assert again.ask(Intent.DAMP) is Mode.DAMPING
    assert again.observation["safety_level"] == SafetyLevel.OK


def test_a_policy_that_fails_is_replaced_and_named():
    operator = Operator(ModesEnv(hasty(), **LITE, action_limit=1e-3))
    operator.ask(Intent.DAMP)
    operator.ask(Intent.LOAD_A, 60)
    faults = []
    for tick in range(8):
        operator.ask(Intent.START_LOCOMOTION if tick == 0 else None)
        faults += operator.info["faults"]
    assert operator.observation["mode"] == Mode.DAMPING
    assert len(faults) == 1
    assert faults[0].startswith("rl_policy_controller: action of ")
    assert operator.ask(Intent.START_LOCOMOTION) is Mode.DAMPING


def test_remote_commands_move_the_robot_until_they_stop_coming():
    operator = Operator(ModesEnv(hasty(), remote=True))
    n = 14
    operator.ask(Intent.DAMP)
    operator.ask(Intent.LOAD_A, 60)
    assert operator.ask(Intent.START_REMOTE) is Mode.REMOTE
    pose = np.array(operator.observation["joint_position"])
    command = np.stack([pose, *np.zeros((2, n)), np.full(n, 50.0), np.full(n, 2.0)])
    command[0, 0] += 0.3
    operator.ask(ticks=60, command=command)
    assert operator.observation["joint_position"][0] - pose[0] > 0.2
    assert operator.info["refusals"] == ()
    idle = {"intent": 0, "send": 0, "command": command}
    statuses = [operator.env.step(idle)[4]["status"] for _ in range(25)]  # 125 ms
    assert statuses[-1] == "no remote command for 100 ms: the joints are damped"
    assert operator.reward == pytest.approx(61 * 0.005)


def test_a_bad_remote_command_is_refused_and_the_robot_is_not_moved_by_it():
    operator = Operator(ModesEnv(hasty(), remote=True))
    bad = np.zeros((5, 14))
    bad[2, 4] = np.nan
    operator.ask(command=bad)
    (refusal,) = operator.info["refusals"]
    assert refusal.startswith("remote command")
    assert "left_wrist_yaw" in refusal
    negative = np.zeros((5, 14))
    negative[3] = -1.0
    operator.ask(Intent.DAMP, command=negative)
    assert len(operator.info["refusals"]) == 1
    assert operator.observation["mode"] == Mode.DAMPING  # the intent beside it is heard
    for shape in ((4, 14), (5, 13), (5,), (0,)):
        operator.ask(command=np.zeros(shape))
        assert operator.info["refusals"] == (f"remote command has shape {shape}, expected (5, 14)",)
    operator.ask(command="faster")
    assert operator.info["refusals"] == ("remote command has shape (0,), expected (5, 14)",)


def test_free_standing_legs_are_held_until_a_policy_takes_over():
    operator = Operator(ModesEnv(hasty("lite_biped"), remote=True))
    assert operator.env.robot.supported
    operator.ask(Intent.DAMP)
    operator.ask(Intent.LOAD_A, 45)
    assert operator.env.robot.supported
    assert operator.ask(Intent.START_REMOTE, command=np.zeros((5, 14))) is Mode.REMOTE
    assert not operator.env.robot.supported
    operator.ask(Intent.DAMP)
    assert operator.env.robot.supported


def test_the_same_intents_give_the_same_episode(shared):
    def rollout():
        operator, seen = Operator(shared), []
        for intent in (Intent.DAMP, None, Intent.LOAD_A, *[None] * 20):
            operator.ask(intent)
            seen.append(b"".join(np.asarray(value).tobytes() for value in operator.observation.values()))
        return seen

    assert rollout() == rollout()
