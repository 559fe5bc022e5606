"""The readers of files from outside: a sound file of each, and what programs do with one that they are given."""

import contextlib
import io
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from formats import shortened

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import load_program

__all__ = ["DEPLOY", "TARGETS", "Target"]

Read = Callable[[Path], object]
_DATA = Path(__file__).parents[1] / "data"


@dataclass(frozen=True, slots=True)
class Target:
    """One kind of file."""

    file: str
    """Its name in a folder of its own."""
    kind: str
    """`mcap`, `npz`, `onnx`, `xml`, `yaml`, `json` or `csv`."""
    prepare: Callable[[Path], bytes]
    """Puts what lies beside it into the folder; returns the sound file."""
    read: Read
    """Everything that programs do with it before, or without, a simulation."""
    weight: float = 1.0
    """Share of mutants, less for a reader that takes long."""


def _run(verb: str, *words: object) -> None:
    """A program; its output goes nowhere, its exit status is not looked at."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        load_program(verb)([str(word) for word in words])


def _tiny_model(folder: Path, *, stamped: bool) -> Path:
    """A checkpoint of the Lite: one matrix, its contract in its metadata; stamped with samples of its own."""
    import onnx  # noqa: PLC0415
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415

    from humanoid_sim.controllers.contract import PolicyContract  # noqa: PLC0415
    from humanoid_sim.policy.metadata import write_metadata  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    lite = load_robot("lite")
    n = len(lite.joint_names)
    contract = PolicyContract(
        task_type="locomotion",
        joint_names=lite.joint_names,
        action_joint_names=lite.joint_names,
        joint_stiffness=lite.stiffness,
        joint_damping=lite.damping,
        default_joint_pos=np.zeros(n),
        observation=("joint_pos", "joint_vel", "actions"),
        command_names=(),
        action_scale=np.full(n, 0.1),
        policy_dt=0.02,
        body_names=(),
    )
    weights = np.arange(3 * n * n, dtype=np.float32).reshape(3 * n, n) / (3 * n * n)
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["observation", "weights"], ["hidden"]),
            helper.make_node("Tanh", ["hidden"], ["action"]),
        ],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, 3 * n])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, n])],
        [numpy_helper.from_array(weights, "weights")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    for key, text in write_metadata(contract).items():
        model.metadata_props.add(key=key, value=text)
    plain = folder / "plain.onnx"
    onnx.save(model, str(plain))
    if not stamped:
        return plain
    _run("policy", "stamp", plain, "--output", folder / "stamped.onnx", "--overwrite")
    return folder / "stamped.onnx"


def _checkpoint(folder: Path) -> bytes:
    return _tiny_model(folder, stamped=False).read_bytes()


def _stamped(folder: Path) -> bytes:
    return _tiny_model(folder, stamped=True).read_bytes()


def _read_checkpoint(path: Path) -> None:
    _run("policy", "show", path)
    _run("policy", "check", path, "--robot", "lite")


def _contract(folder: Path) -> bytes:
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415
    from humanoid_sim.policy.contract_json import encode  # noqa: PLC0415

    path = _tiny_model(folder, stamped=False)
    document = json.loads(encode(load_checkpoint(path).contract))
    del document["version"], document["provenance"]
    return json.dumps(document).encode()


def _read_contract(path: Path) -> None:
    _run("policy", "show", path.parent / "plain.onnx", "--contract", path)


DEPLOY: dict[str, Any] = {
    "joint_ids_map": [2, 0, 3, 1],
    "step_dt": 0.02,
    "stiffness": [10.0, 11.0, 12.0, 13.0],
    "damping": [1.0, 1.1, 1.2, 1.3],
    "default_joint_pos": [0.2, 0.0, 0.3, 0.1],
    "commands": {
        "base_velocity": {"ranges": {"lin_vel_x": [-1, 1], "lin_vel_y": [0, 0], "ang_vel_z": [-2, 2], "heading": None}}
    },
    "actions": {"JointPositionAction": {"clip": None, "joint_names": [".*"], "scale": [0.25] * 4, "offset": [0.0] * 4}},
    "observations": {
        "base_ang_vel": {"params": {}, "clip": None, "scale": [0.2, 0.2, 0.2], "history_length": 5},
        "joint_pos_rel": {"params": {}, "clip": [-10, 10], "scale": None, "history_length": 0},
        "gait_phase": {"params": {"period": 0.6}, "clip": None, "scale": [1.0, 1.0]},
    },
}


def _read_deploy(path: Path) -> None:
    from humanoid_sim.policy.readers.merge import merge  # noqa: PLC0415
    from humanoid_sim.policy.readers.unitree import find_deploy, read_deploy  # noqa: PLC0415

    found = find_deploy(path.parent / "policy.onnx")
    assert found is not None
    merge([read_deploy(found)], "policy.onnx", ("a", "b", "c", "d"))


BERKELEY: dict[str, Any] = {
    "policy_checkpoint_path": "checkpoints/policy.onnx",
    "control_dt": 0.004,
    "policy_dt": 0.02,
    "num_joints": 4,
    "joints": ["a", "b", "c", "d"],
    "joint_kp": [20.0] * 4,
    "joint_kd": [2.0] * 4,
    "effort_limits": [6.0] * 4,
    "default_base_position": [0.0, 0.0, 0.0],
    "default_joint_positions": [0.0, 0.1, 0.2, 0.3],
    "num_observations": 21,
    "history_length": 0,
    "num_actions": 4,
    "action_indices": [0, 1, 2, 3],
    "action_scale": 0.25,
    "action_limit_lower": -10000,
    "action_limit_upper": 10000,
    "command_velocity": [0.2, 0.0, 0.0],
}


def _read_berkeley(path: Path) -> None:
    from humanoid_sim.policy.readers.berkeley import find_berkeley, read_berkeley  # noqa: PLC0415
    from humanoid_sim.policy.readers.merge import merge  # noqa: PLC0415

    found = find_berkeley(path.parent / "policy.onnx")
    if found is not None:
        merge([read_berkeley(found)], "policy.onnx", ("a", "b", "c", "d"))


def _robot(folder: Path) -> bytes:
    import yaml  # noqa: PLC0415

    shutil.copytree(asset_path("mjcf"), folder / "mjcf", dirs_exist_ok=True)
    document = yaml.safe_load(asset_path("robots", "lite.yaml").read_text(encoding="utf-8"))
    document["mjcf"] = "mjcf/lite.xml"
    return json.dumps(document).encode()


def _partial_robot(folder: Path) -> bytes:
    shutil.copy(_DATA / "hopper.xml", folder)
    document = {
        "name": "hopper",
        "mjcf": "hopper.xml",
        "imu": "my_imu",
        "base": {"height": 1.0},
        "simulation": {"physics_timestep": 0.001, "control_frequency": 200.0, "joint_damping": "keep"},
        "initial_position": {"knee": 0.5},
        "joints": {"hip": {"effort_limit": 20.0, "stiffness": 30.0, "damping": 0.5}, "knee": {"lower": 0.3}},
    }
    return json.dumps(document).encode()


def _read_robot(path: Path) -> None:
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415
    from humanoid_sim.simulation.mujoco_robot import MujocoRobot  # noqa: PLC0415

    _run("robot", "describe", path)
    robot = MujocoRobot(load_robot(path))
    robot.read()
    robot.close()


MJCF = b"""\
<mujoco model="yard">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <size memory="1M" nuserdata="3"/>
  <custom><numeric name="n" size="4" data="1 2"/></custom>
  <asset>
    <hfield name="hill" nrow="20" ncol="20" size="2 2 0.3 0.1"/>
    <texture name="grid" type="2d" builtin="checker" width="64" height="64" rgb1="0 0 0" rgb2="1 1 1"/>
    <material name="grid" texture="grid" texrepeat="4 4"/>
    <mesh name="ball" builtin="sphere" params="2"/>
  </asset>
  <worldbody>
    <geom type="hfield" hfield="hill" pos="0 0 -1" material="grid"/>
    <replicate count="3" offset="0.2 0 0" euler="0 0 0.1"><geom type="sphere" size="0.02" pos="1 1 0"/></replicate>
    <flexcomp name="cloth" type="grid" count="4 4 1" spacing="0.05 0.05 0.05" pos="0 1 1" radius="0.01" dim="2"/>
    <composite prefix="rope" type="cable" count="5 1 1" offset="1 0 1" curve="s" size="0.3">
      <joint kind="main" damping="0.01"/><geom type="capsule" size="0.005"/></composite>
    <body name="trunk" pos="0 0 1">
      <freejoint/>
      <geom type="mesh" mesh="ball" mass="3"/>
      <site name="imu"/>
      <body name="thigh" pos="0 0 -0.1">
        <joint name="hip" axis="0 1 0" range="-1 1" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="1"/>
        <body name="shank" pos="0 0 -0.2">
          <joint name="knee" axis="0 1 0" range="0.2 2" armature="0.02"/>
          <geom name="foot" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="0.5"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="hip" joint="hip" gear="5" ctrlrange="-4 4"/><position joint="knee" kp="100"/></actuator>
  <sensor><gyro site="imu"/><user dim="3"/></sensor>
</mujoco>
"""
"""A robot in a yard: with everything whose size is a number in the file."""


def _hopper(folder: Path) -> bytes:
    del folder
    return (_DATA / "hopper.xml").read_bytes()


def _recording(folder: Path) -> bytes:
    whole = (_DATA / "recordings" / "simulated_locomotion.mcap").read_bytes()
    return shortened(whole, messages=400, skip=1200)


def _read_recording(path: Path) -> None:
    from humanoid_sim.errors import InputError  # noqa: PLC0415
    from humanoid_sim.messages import Mode  # noqa: PLC0415
    from humanoid_sim.play.options import PlayConfig  # noqa: PLC0415
    from humanoid_sim.play.policies import with_recorded_options  # noqa: PLC0415
    from humanoid_sim.policy.motion import read_motion  # noqa: PLC0415
    from humanoid_sim.record_dataset import _task  # noqa: PLC0415
    from humanoid_sim.recording.episodes import read_episodes  # noqa: PLC0415
    from humanoid_sim.recording.reader import open_recording  # noqa: PLC0415

    def episodes() -> None:
        recording = open_recording(path)
        for episode in read_episodes(recording, frozenset(Mode)):
            _task(recording, episode)

    beside = {kind: path.with_name(f"recovered.{kind}") for kind in ("csv", "urdf")}
    reads: tuple[Callable[[], object], ...] = (
        lambda: _run("record", "info", path),
        lambda: _run("record", "info", path, "--json"),
        lambda: _run("record", "recover", path, "--output", path.parent / "recovered.mcap", "--overwrite"),
        lambda: _run("replay", path),
        lambda: _run("replay", path, "--infer", "--json"),
        lambda: _run("compare", path, path),
        lambda: _run("record", "export", path, "--csv", beside["csv"], "--urdf", beside["urdf"], "--overwrite"),
        episodes,
        lambda: read_motion(path),
        lambda: with_recorded_options(PlayConfig(again=str(path))),
    )
    refused = 0
    last: InputError | None = None
    for read in reads:
        try:
            read()
        except InputError as error:
            last, refused = error, refused + 1
    if last is not None and refused == len(reads):
        raise last


def _motion(folder: Path) -> bytes:
    del folder
    return shortened(asset_path("motions", "wave.mcap").read_bytes(), messages=20)


def _read_motion(path: Path) -> None:
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415
    from humanoid_sim.policy.motion import read_motion  # noqa: PLC0415

    motion = read_motion(path)
    global _SAMPLE  # noqa: PLW0603
    _SAMPLE = _SAMPLE or load_checkpoint(asset_path("policies", "lite_tracking.onnx"))
    _SAMPLE.following(motion)


_SAMPLE: Any = None


def _motion_npz(folder: Path) -> bytes:
    del folder
    rng = np.random.default_rng(1)
    stream = io.BytesIO()
    quaternion = np.tile(np.float32([1, 0, 0, 0]), (6, 15, 1))
    joints = rng.normal(0, 0.1, (6, 14)).astype(np.float32)
    position = rng.normal(0, 0.3, (6, 15, 3)).astype(np.float32)
    np.savez(
        stream,
        fps=np.array([50.0]),
        joint_pos=joints,
        joint_vel=joints,
        body_pos_w=position,
        body_quat_w=quaternion,
        joint_names=np.array([f"joint_{i}" for i in range(14)]),
    )
    return stream.getvalue()


def _read_motion_npz(path: Path) -> None:
    from humanoid_sim.prepare.motion_files import read_npz  # noqa: PLC0415

    read_npz(path)


def _csv(folder: Path) -> bytes:
    del folder
    rows = np.random.default_rng(2).normal(0, 0.1, (12, 14)).round(4)
    return ("\n".join(",".join(str(value) for value in row) for row in rows) + "\n").encode()


def _read_csv(path: Path) -> None:
    from humanoid_sim.prepare.motion_files import read_csv  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    read_csv(path, load_robot("lite").joint_names, 50.0, floating=False, quaternions=None)


def _trace(folder: Path) -> bytes:
    del folder
    rng = np.random.default_rng(3)
    stream = io.BytesIO()
    np.savez(
        stream,
        joint_names=np.array(["a", "b", "c"]),
        joint_position=rng.normal(size=(5, 3)),
        joint_velocity=rng.normal(size=(5, 3)),
        imu_quaternion=np.tile([1.0, 0, 0, 0], (5, 1)),
        imu_angular_velocity=np.zeros((5, 3)),
        obs=rng.normal(size=(5, 9)).astype(np.float32),
        actions=rng.normal(size=(5, 3)).astype(np.float32),
        frame=np.arange(5),
    )
    return stream.getvalue()


def _read_trace(path: Path) -> None:
    from humanoid_sim.controllers.contract import PolicyContract  # noqa: PLC0415
    from humanoid_sim.policy.golden.trace import read_trace  # noqa: PLC0415

    joints = ("a", "b", "c")
    contract = PolicyContract(
        task_type="locomotion",
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=np.ones(3),
        joint_damping=np.ones(3),
        default_joint_pos=np.zeros(3),
        observation=("joint_pos", "joint_vel", "actions"),
        command_names=(),
        action_scale=np.ones(3),
        policy_dt=0.02,
        body_names=(),
    )
    read_trace(path, contract)


def _baseline(folder: Path) -> bytes:
    del folder
    from humanoid_sim.evaluation.failure import DEFINITIONS  # noqa: PLC0415
    from humanoid_sim.regress.files import json_of  # noqa: PLC0415
    from humanoid_sim.regress.results import Episode, PolicyRun  # noqa: PLC0415

    episodes = tuple(
        Episode(
            case="wave",
            seed=seed,
            steps=50,
            duration=1.0,
            metrics={"joint_error": 0.1 + 0.01 * seed, "losses": 0.0, "faults": 0.0},
            trace_times=(0.0, 0.5),
            traces={"joint_error": (0.1, None)},
        )
        for seed in range(3)
    )
    run = PolicyRun(
        name="p",
        source="p.onnx",
        sha256="0" * 64,
        suite="tiny",
        case_digests={"wave": "0" * 64},
        episodes=episodes,
        definitions=dict(DEFINITIONS),
    )
    return json_of(run)


def _read_baseline(path: Path) -> None:
    from humanoid_sim.regress.compare import compare_runs  # noqa: PLC0415
    from humanoid_sim.regress.files import matching_baseline, read_baseline  # noqa: PLC0415
    from humanoid_sim.regress.options import RegressConfig  # noqa: PLC0415
    from humanoid_sim.regress.preparation import PreparedSuite  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    run = read_baseline(path)
    config = RegressConfig(policies=("p.onnx",), suite="lite_tracking", baseline=str(path))
    suite, metrics = _suite_and_metrics()
    prepared = PreparedSuite(suite, "lite", load_robot("lite"), {}, {"wave": "0" * 64})
    kept = matching_baseline(prepared, run, config)
    compare_runs(suite, metrics, kept, kept)


def _suite_and_metrics() -> Any:
    from humanoid_sim.regress.suite import Case, Suite, Tolerance  # noqa: PLC0415

    suite = Suite(
        name="tiny",
        task="tracking",
        robot="lite",
        cases=(Case(name="wave", motion="wave"),),
        seeds=3,
        tolerances={"joint_error": Tolerance(relative=0.05)},
        resamples=200,
    )
    return suite, suite.metrics


def _suite(folder: Path) -> bytes:
    del folder
    import yaml  # noqa: PLC0415

    return json.dumps(yaml.safe_load(asset_path("suites", "lite_tracking.yaml").read_text(encoding="utf-8"))).encode()


def _read_suite(path: Path) -> None:
    from humanoid_sim.regress.preparation import prepare_suite  # noqa: PLC0415
    from humanoid_sim.regress.suite import load_suite  # noqa: PLC0415

    del prepare_suite
    load_suite(str(path))


def _calibration(folder: Path) -> bytes:
    del folder
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    entries = {
        joint.name: {"id": joint.motor.can_id, "direction": joint.motor.direction, "homing_offset": 0.125}
        for joint in load_robot("lite").joints
        if joint.motor is not None
    }
    return json.dumps(entries).encode()


def _read_calibration(path: Path) -> None:
    from humanoid_sim.hardware.calibration import load_calibration  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415

    load_calibration(path, load_robot("lite")).homing_offsets(load_robot("lite"))


def _dataset(folder: Path) -> bytes:
    del folder
    return json.dumps({"codebase_version": "v3.0", "fps": 50, "features": {}}).encode()


def _read_dataset(path: Path) -> None:
    from humanoid_sim.prepare.lerobot_dataset import _check_format  # noqa: PLC0415

    (path.parent / "meta").mkdir(exist_ok=True)
    shutil.copy(path, path.parent / "meta" / "info.json")
    _check_format(path.parent)


def _constant(document: Any) -> Callable[[Path], bytes]:
    return lambda _: json.dumps(document).encode()


TARGETS: Mapping[str, Target] = {
    "checkpoint": Target("policy.onnx", "onnx", _checkpoint, _read_checkpoint, 0.6),
    "stamped checkpoint": Target("policy.onnx", "onnx", _stamped, _read_checkpoint, 0.6),
    "contract.yaml": Target("contract.yaml", "yaml", _contract, _read_contract),
    "deploy.yaml": Target("deploy.yaml", "yaml", _constant(DEPLOY), _read_deploy),
    "Berkeley's YAML": Target("policy.yaml", "yaml", _constant(BERKELEY), _read_berkeley),
    "robot": Target("robot.yaml", "yaml", _robot, _read_robot, 0.4),
    "partial robot": Target("robot.yaml", "yaml", _partial_robot, _read_robot),
    "MJCF": Target("hopper.xml", "xml", _hopper, _read_robot),
    "MJCF with everything": Target("yard.xml", "xml", lambda _: MJCF, _read_robot, 0.5),
    "motion": Target("motion.mcap", "mcap", _motion, _read_motion),
    "motion .npz": Target("motion.npz", "npz", _motion_npz, _read_motion_npz),
    "motion .csv": Target("motion.csv", "csv", _csv, _read_csv),
    "trace": Target("trace.npz", "npz", _trace, _read_trace),
    "recording": Target("run.mcap", "mcap", _recording, _read_recording, 0.3),
    "baseline": Target("baseline.json", "json", _baseline, _read_baseline),
    "suite": Target("suite.yaml", "yaml", _suite, _read_suite),
    "calibration": Target("calibration.yaml", "yaml", _calibration, _read_calibration),
    "dataset": Target("info.json", "json", _dataset, _read_dataset),
}
