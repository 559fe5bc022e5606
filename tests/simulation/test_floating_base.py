"""A robot whose base moves: where it starts, what holds it, how its motion is seen."""

import math
from dataclasses import replace

import msgspec
import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState, base_addresses, support_in_mode
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot

LIMP = MITCommand.zeros(2)
SOLE = 0.1 + 0.2 + 0.2 * math.cos(0.2) + 0.03
"""m, from the hopper's trunk down to the floor that its foot touches, in the initial position."""


def base_of(robot):
    state = robot.base
    assert state is not None
    return state


def run(robot, seconds, command=LIMP):
    for _ in range(round(seconds / robot.control_period)):
        robot.write(command)


def stiff(robot):
    hold = np.array(robot.description.initial_position)
    return MITCommand(hold, np.zeros(2), np.zeros(2), np.full(2, 200.0), np.full(2, 4.0))


HOVERING = '<option density="0"><flag contact="disable"/></option><option'


class TestStart:
    @pytest.mark.parametrize(
        ("old", "new", "height"),
        [
            ("", "", SOLE),
            ('pos="0.2 0 1"', 'pos="0 0 -1"', SOLE),  # it finds the floor from below too
            ('<geom name="ground" type="plane" size="0 0 0.05"/>', "", SOLE),  # a floor that the scene adds counts
            ("<option", HOVERING, 1.0),  # with nothing to touch it starts where the MJCF has it
        ],
    )
    def test_the_lowest_part_touches_the_floor(self, hopper, old, new, height):
        hopper.write_text(hopper.read_text().replace(old, new) if old else hopper.read_text())
        state = base_of(SimRobot(load_robot(hopper)))
        assert state.height == pytest.approx(height, abs=1e-9)
        if not old:
            assert state.position == pytest.approx([0.0, 0.0, SOLE], abs=1e-9)
            assert state.quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]

    def test_activation_puts_it_back_and_holds_it_again(self, hopper):
        robot = SimRobot(load_robot(hopper))
        robot.set_support(False)
        run(robot, 1.0)
        assert base_of(robot).height < 0.9 * SOLE
        robot.activate()
        assert robot.supported
        assert base_of(robot).height == pytest.approx(SOLE, abs=1e-9)
        assert not base_of(robot).linear_velocity.any()
        assert robot.time == pytest.approx(1.0)


class TestSupport:
    def test_it_hangs_above_the_floor_and_released_it_falls(self, hopper):
        robot = SimRobot(load_robot(hopper), SimConfig(drop=0.05))
        assert robot.supported
        run(robot, 2.0, stiff(robot))
        assert base_of(robot).height == pytest.approx(SOLE + 0.05, abs=1e-3)
        assert base_of(robot).tilt < 0.01
        robot.set_support(False)
        assert not robot.supported
        run(robot, 0.09, stiff(robot))
        assert robot.data.ncon == 0
        assert base_of(robot).linear_velocity[2] == pytest.approx(-9.81 * 0.09, rel=0.02)
        run(robot, 0.02, stiff(robot))
        assert robot.data.ncon > 0

    def test_released_the_support_leaves_no_trace(self, hopper):
        """The dynamics are those of the MJCF without any support."""
        described = load_robot(hopper)
        described = msgspec.structs.replace(described, base=msgspec.structs.replace(described.base, height=0.7))
        robot = SimRobot(described, SimConfig(support=False))
        spec = mujoco.MjSpec.from_file(str(hopper))
        spec.option.timestep, spec.option.integrator = 0.001, mujoco.mjtIntegrator.mjINT_EULER
        for thing in (*spec.actuators, *spec.keys, *spec.sensors):
            spec.delete(thing)
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = robot.qpos
        run(robot, 1.0)
        mujoco.mj_step(model, data, 1000)
        assert data.qpos.tolist() == robot.qpos.tolist()

    def test_a_fixed_base_needs_none(self):
        robot = SimRobot(load_robot("lite"))
        assert not robot.supported
        assert robot.base is None
        assert dict(robot.extern) == {}
        with pytest.raises(RobotError, match=r"^lite: has a fixed base, which needs no support"):
            robot.set_support(True)


def test_base_state_in_words():
    """Leaning forward by 0.4 rad, turned by 2 rad, moving along its heading."""
    half_yaw, half_pitch = 1.0, 0.2
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(
        quaternion,
        np.array([math.cos(half_yaw), 0, 0, math.sin(half_yaw)]),
        np.array([math.cos(half_pitch), 0, math.sin(half_pitch), 0]),
    )
    velocity = np.array([math.cos(2.0) * 0.5, math.sin(2.0) * 0.5, 0.1])
    turning = np.array([-math.sin(0.4), 0.0, math.cos(0.4)])
    mass = np.array([1.1, 2.0, 0.6])
    state = BaseState(np.array([1.0, 2.0, 0.7]), quaternion, velocity, turning, mass, np.array(0.25))
    assert state.height == pytest.approx(0.45)
    assert state.mass_height == pytest.approx(0.35)
    assert state.tilt == pytest.approx(0.4)
    assert state.yaw == pytest.approx(2.0)
    assert state.planar_velocity == pytest.approx([0.5, 0.0, 1.0])
    for quaternion, tilt in (([1, 0, 0, 0], 0.0), ([0, 1, 0, 0], math.pi), ([0, 0, 0, 1], 0.0)):
        assert replace(state, quaternion=np.array(quaternion, dtype=float)).tilt == pytest.approx(tilt)


def test_the_support_lets_go_for_a_policy_and_takes_over_after_it():
    robot = SimRobot(load_robot("lite_biped"))
    said = []
    for mode in (Mode.STANDBY, Mode.LOCOMOTION, Mode.LOCOMOTION, Mode.REMOTE, Mode.DAMPING, Mode.ZERO_TORQUE):
        said.append(support_in_mode(robot, mode))
        assert robot.supported is not mode.is_free
    assert said == ["", "support released", "", "", "support holds the base where it is", ""]


def test_damp_catches_the_robot_and_in_standby_it_is_lifted_slowly_to_where_it_hung_at_first(hopper):
    robot = SimRobot(load_robot(hopper), SimConfig(drop=0.03))
    support_in_mode(robot, Mode.LOCOMOTION)
    run(robot, 0.3)
    support_in_mode(robot, Mode.DAMPING)
    run(robot, 0.3)
    low = base_of(robot).height
    assert low < SOLE - 0.05
    assert support_in_mode(robot, Mode.STANDBY) == ""
    run(robot, 0.3)
    assert base_of(robot).height == pytest.approx(low + 0.03, abs=0.005)
    run(robot, 3.0)
    assert base_of(robot).height == pytest.approx(SOLE + 0.03, abs=1e-3)
    assert support_in_mode(robot, Mode.LOCOMOTION) == "support released"


def test_a_base_that_stands_on_another_axis_is_upright_there():
    biped = load_robot("lite_biped")
    model = build_model(biped)
    _, quaternion, *_ = base_addresses(model, biped)
    model.qpos0[quaternion] = [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]  # its x axis points down
    observer = BaseObserver(model, biped)
    assert observer.at(model.qpos0, np.zeros(model.nv), np.zeros(3)).tilt == pytest.approx(0.0, abs=1e-6)
    lying = model.qpos0.copy()
    lying[quaternion] = [1.0, 0.0, 0.0, 0.0]
    assert observer.at(lying, np.zeros(model.nv), np.zeros(3)).tilt == pytest.approx(np.pi / 2)
