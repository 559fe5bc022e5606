"""What the judgement of signs sees of planted faults, and that it accuses no sound robot: a table over robots.

    python -m tools.studies.sign_faults [--variations 40] [NAME ...]

A robot hangs at rest: its pose is the equilibrium of K_p, gravity, friction and stops, in a model whose every mass is
off by up to 10 %, with a payload of up to 0.5 kg on any body, up to 0.3 N·m of friction (or the MJCF's, if that is
more), encoders off by up to 0.01 rad, an IMU by up to 0.02 rad, and a base that hangs up to 0.1 rad askew.
"""

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.controllers.signs import AGREES, SignMemory, Signs
from humanoid_sim.mit import GRAVITY_LEVERS, Extern, FloatArray, MITCommand
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.robots.description import check_poses, load_robot, with_contract
from humanoid_sim.robots.schema import RobotDescription, SignSettings, StandbySettings
from humanoid_sim.simulation.check_poses import check_pose_problems
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.gravity import GravityLevers
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.sensors import Imu
from humanoid_sim.testing import healthy_state

sys.path.append(str(Path(__file__).parents[2] / "tests" / "policy"))

from published import HOLOSOMA_REST, POLICIES

OFFSET = 0.4
"""rad"""
_SAMPLES = 3
"""In each pose; the first only shows that the joints rest."""
G1_CHECK_POSE = {
    **{
        f"{side}_{joint}": sign * value
        for side, sign in (("left", 1), ("right", -1))
        for joint, value in {"hip_roll_joint": 0.45, "shoulder_yaw_joint": 0.47}.items()
    },
    **{
        f"{side}_{joint}": value
        for side in ("left", "right")
        for joint, value in {"ankle_pitch_joint": -0.46, "elbow_joint": -0.05, "wrist_pitch_joint": -0.24}.items()
    },
    "waist_pitch_joint": -0.11,
}


class Hanging:
    """A robot that differs from its model, and what it reports at rest; without a generator it is its model."""

    def __init__(self, robot: RobotDescription, generator: np.random.Generator | None = None) -> None:
        self._robot, self._model = robot, build_model(robot, scene=False)
        self._data = mujoco.MjData(self._model)
        self._joints = joint_addresses(self._model, robot.joint_names)
        self._imu = Imu(self._model, robot.imu)
        self._base = base_addresses(self._model, robot)[1] if robot.is_floating else None
        self.stiffness = np.array(robot.standby_controller_a.target_stiffness)
        n, model = robot.joint_count, self._model
        self._friction, self._encoder = np.zeros(n), np.zeros(n)
        self._payload: tuple[int, float, FloatArray] | None = None
        self._hangs = self._tilt = np.array([1.0, 0.0, 0.0, 0.0])
        if generator is None:
            return
        model.body_mass *= 1.0 + generator.uniform(-0.1, 0.1, model.nbody)
        mujoco.mj_setConst(model, self._data)
        loss = model.dof_frictionloss[self._joints.dof]
        self._friction = generator.uniform(-1.0, 1.0, n) * np.maximum(0.3, loss)
        bodies = np.flatnonzero(model.body_mass > 0.0)
        place = generator.uniform(-0.03, 0.03, 3)
        self._payload = int(generator.choice(bodies)), 0.5 * generator.choice([1.0, generator.random()]), place
        self._encoder = generator.uniform(-0.01, 0.01, n)
        self._tilt = _turn(generator, 0.02)
        self._hangs = _turn(generator, 0.1)

    def rest(self, pose: FloatArray, sign: FloatArray, offset: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return readings, rad, efforts, N·m, and the IMU's quaternion in a pose of joints with these faults.

        A joint reads `sign * position + offset`; efforts have the sign as well.
        """
        robot = self._robot
        place = np.clip(sign * (pose - offset), robot.lower, robot.upper)
        for _ in range(300):
            wanted = sign * (pose - sign * (self._gravity(place) + self._friction) / self.stiffness - offset)
            step = np.clip(wanted, robot.lower, robot.upper) - place
            place = place + 0.5 * step
            if np.abs(step).max() < 1e-6:
                break
        reading = sign * place + offset
        effort = np.clip(self.stiffness * (pose - reading), -robot.effort_limit, robot.effort_limit)
        self._gravity(place)
        return reading + self._encoder, effort, multiply(self._tilt, self._imu.read(self._data).quaternion)

    def _gravity(self, place: FloatArray) -> FloatArray:
        model, data = self._model, self._data
        data.qpos[self._joints.qpos] = place
        if self._base is not None:
            data.qpos[self._base] = self._hangs
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        needed = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 0, needed)
        if self._payload is not None:
            body, mass, where = self._payload
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, data.xipos[body] + where, body)
            needed += 9.81 * mass * jacobian[2]
        return needed[self._joints.dof]


def _turn(generator: np.random.Generator, most: float) -> FloatArray:
    axis = generator.normal(size=3)
    angle = generator.uniform(0.0, most)
    return np.append(np.cos(0.5 * angle), np.sin(0.5 * angle) * axis / np.linalg.norm(axis))


class Judge:
    """The judgement of a robot in its standby pose and, if they are wanted, its check poses."""

    def __init__(self, robot: RobotDescription, *, checks: bool = False) -> None:
        self._robot = robot
        self._levers = GravityLevers(robot, robot.signs or SignSettings())
        self._signs = Signs(robot.joint_names, robot.lower, robot.upper)
        standby = robot.standby_controller_a.pose_segments[-1]
        self._poses = [np.array(pose) for pose in (standby, *(check_poses(robot, standby) if checks else ()))]

    def __call__(self, hanging: Hanging, joint: int = 0, sign: float = 1.0, offset: float = 0.0) -> SignMemory:
        """Return what is remembered of a robot, one of whose joints may be faulty."""
        n = self._robot.joint_count
        signs, offsets, zeros = np.ones(n), np.zeros(n), np.zeros(n)
        signs[joint], offsets[joint] = sign, offset
        memory, time = None, 0.0
        for pose in self._poses:
            reading, effort, quaternion = hanging.rest(pose, signs, offsets)
            command = MITCommand(pose, zeros, zeros, hanging.stiffness, zeros)
            for _ in range(_SAMPLES):
                time += 0.1
                state = replace(healthy_state(reading, time), joint_effort=effort, imu_quaternion=quaternion)
                live = {GRAVITY_LEVERS: Extern(self._levers(state), time)}
                memory = self._signs.watch(memory, replace(state, extern=live), command, is_finished=True)
        assert memory is not None
        return memory


@dataclass(frozen=True)
class Row:
    """Counts for one robot."""

    joints: int
    agree: float
    """Joints of a sound robot that agree, on average."""
    variations: int
    accused: int
    """Sound robots that something was said against."""
    flips: int
    """Mirrored joints for which START is refused, the joint named, or named among those that explain it as well."""
    flips_elsewhere: int
    """Those for which only other joints are named."""
    warned: tuple[int, int]
    """Offsets, less and more, of which the operator is warned."""
    refused: tuple[int, int]
    """Offsets for which START is refused, because a direction explains as much."""


def study(robot: RobotDescription, variations: int, *, checks: bool = False) -> Row:
    """Judge sound robots, and the nominal one with every single fault."""
    judge, n = Judge(robot, checks=checks), robot.joint_count
    sound = [judge(Hanging(robot, np.random.default_rng(i))) for i in range(variations)]
    model = Hanging(robot)
    flips = [judge(model, joint, -1.0).refusal for joint in range(n)]
    right = sum(name in re.findall(r"\w+", text) for name, text in zip(robot.joint_names, flips, strict=True))
    found = [[judge(model, joint, 1.0, by) for joint in range(n)] for by in (-OFFSET, OFFSET)]
    warned = [sum("contradict" in memory.notice and not memory.refusal for memory in row) for row in found]
    refused = [sum(bool(memory.refusal) for memory in row) for row in found]
    return Row(
        joints=n,
        agree=float(np.mean([(memory.verdict == AGREES).sum() for memory in [*sound, judge(model)]])),
        variations=variations,
        accused=sum("contradict" in memory.notice for memory in sound),
        flips=right,
        flips_elsewhere=sum(map(bool, flips)) - right,
        warned=(warned[0], warned[1]),
        refused=(refused[0], refused[1]),
    )


def robots(names: Sequence[str] = ()) -> Iterator[tuple[str, RobotDescription]]:
    """Yield the robots of the table, those that are here; all, or those of some names."""
    for name in ("lite", "lite_sito", "lite_biped"):
        if not names or name in names:
            yield name, load_robot(name)
    if not POLICIES.is_dir():
        return
    with tempfile.TemporaryDirectory() as folder:
        rest = Path(folder) / "rest.yaml"
        rest.write_text(HOLOSOMA_REST, encoding="utf-8")
        for name, model, policy, contract in (
            ("g1_holosoma", "unitree_g1", "holosoma_g1_loco/ppo_g1_29dof.onnx", rest),
            ("g1_unitree", "unitree_g1", "unitree_g1_velocity_v0/exported/policy.onnx", None),
            (
                "berkeley_biped",
                "berkeley_humanoid_lite_biped",
                "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx",
                None,
            ),
        ):
            if not names or name in names:
                robot = load_robot(str(POLICIES / "models" / model / "scene.xml"))
                robot = with_contract(robot, read_contract(POLICIES / policy, contract, robot.joint_names))
                checks = (G1_CHECK_POSE,) if model == "unitree_g1" else ()
                yield name, msgspec.structs.replace(robot, check_poses=checks)
        if not names or "berkeley_humanoid" in names:
            yield "berkeley_humanoid", _playground()


def _playground() -> RobotDescription:
    facts = json.loads((POLICIES / "playground_berkeley_humanoid" / "facts.json").read_text(encoding="utf-8"))
    robot = load_robot(str(POLICIES / "models" / "playground_berkeley_humanoid" / "scene_native.xml"))
    assert list(robot.joint_names) == facts["joint_order"]
    pose = tuple(facts["default_joint_pos"])
    standby = StandbySettings(
        target_stiffness=tuple(facts["kp"]),
        target_damping=tuple(facts["kd"]),
        segment_durations=(1.0,),
        pose_segments=(pose,),
    )
    return msgspec.structs.replace(
        robot, initial_position=pose, standby_controller_a=standby, standby_controller_b=standby
    )


def main() -> None:
    """Print the table, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="robots of the table; all if none is named")
    parser.add_argument("--variations", type=int, default=40, help="sound robots of each kind")
    options = parser.parse_args()
    print("| robot | sound robots accused | joints that agree | mirrored joints refused | offsets of 0.4 rad seen |")
    print("|---|---|---|---|---|")
    for name, robot in robots(options.names):
        for checks in (False, True)[: 1 + bool(robot.check_poses)]:
            for problem in check_pose_problems(robot):
                sys.exit(f"{name}: {problem}")
            row = study(robot, options.variations, checks=checks)
            label = f"{name}, check poses" if checks else name
            seen = ", ".join(f"{w + r}" for w, r in zip(row.warned, row.refused, strict=True))
            elsewhere = f" ({row.flips_elsewhere} at another joint)" if row.flips_elsewhere else ""
            print(
                f"| {label} | {row.accused} of {row.variations} | {row.agree:.1f} of {row.joints} "
                f"| {row.flips}{elsewhere} of {row.joints} "
                f"| {seen} of {row.joints} each; {sum(row.refused)} refused |",
                flush=True,
            )


if __name__ == "__main__":
    main()
