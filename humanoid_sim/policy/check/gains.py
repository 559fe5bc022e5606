"""Whether motors can be told the policy's gains, and whether they are stable in simulation."""

from __future__ import annotations

from collections.abc import Iterator

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.check.finding import Finding
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS, MotorModel
from humanoid_sim.robots.schema import MotorDescription

__all__ = ["motor_findings", "stability_finding"]

_COARSE = 0.02
"""Relative error at which the rounding of a gain by the motor's format is worth a word."""


def motor_findings(contract: PolicyContract, description: RobotDescription, *, hardware: bool) -> Iterator[Finding]:
    """Gains beyond what the robot's motors can encode, joint by joint."""
    motors = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    if not motors:
        message = f"'{description.name}' has no motors in its description"
        yield Finding("error" if hardware else "info", "robot", f"{message}: gains were not compared with their limits")
        return
    for i, joint in enumerate(contract.joint_names):
        motor = motors.get(joint)
        if motor is None:
            if hardware and joint in description.joint_names:
                yield Finding("error", "robot", "has no motor in the robot's description", joint=joint)
            continue
        limits = MOTORS.get(motor.model)
        if limits is None:
            message = f"motor model '{motor.model}' is not known; known: {', '.join(MOTORS)}"
            yield Finding("warning", "robot", message, joint=joint)
            continue
        yield from _joint_findings(joint, contract, i, motor, limits)


def _joint_findings(
    joint: str, contract: PolicyContract, i: int, motor: MotorDescription, limits: MotorModel
) -> Iterator[Finding]:
    for field, value, limit, step in (
        ("joint_stiffness", float(contract.joint_stiffness[i]), limits.stiffness, limits.stiffness_step),
        ("joint_damping", float(contract.joint_damping[i]), limits.damping, limits.damping_step),
    ):
        if value > limit:
            message = f"is {value:g}, but motor {motor.model} encodes at most {limit:g}"
            yield Finding("error", field, message, joint, value, limit)
        elif 0.0 < value < step / _COARSE:
            message = f"is {value:g}, which motor {motor.model} encodes in steps of {step:.2g}"
            yield Finding("warning", field, message, joint, value, step)


def stability_finding(
    contract: PolicyContract, description: RobotDescription, physics_timestep: float | None
) -> Iterator[Finding]:
    """Whether the policy's damping is stable at the physics step: `humanoid_sim.simulation.stability`.

    The joints' names must be the robot's.

    Raises:
        InputError: the robot's MJCF cannot be simulated.
    """
    from humanoid_sim.controllers.action import resolve_action  # noqa: PLC0415
    from humanoid_sim.robots.contract_gains import with_contract  # noqa: PLC0415
    from humanoid_sim.simulation.model import build_model  # noqa: PLC0415 - MuJoCo is heavy
    from humanoid_sim.simulation.stability import REFUSED_ABOVE, WARNED_ABOVE, DampingStability  # noqa: PLC0415

    robot = with_contract(description, contract)
    model = build_model(robot, physics_timestep=physics_timestep, scene=False)
    timestep = float(model.opt.timestep)
    damping = resolve_action(contract, description.joint_names).damping
    measure = DampingStability(model, robot).measure(damping)
    if measure.eigenvalue <= WARNED_ABOVE:
        return
    joint, value = measure.joint, measure.eigenvalue
    gain = float(damping[description.joint_names.index(joint)])
    what = f"is {gain:g}: dt·M⁻¹·K_d reaches {value:.2f} with a physics step of {timestep:g} s"
    if value > REFUSED_ABOVE:
        longest = timestep * REFUSED_ABOVE / value
        message = f"{what}, unstable above {REFUSED_ABOVE:g}"
        if longest > 0.0:
            message += f"; a step below {longest:.2g} s works"
        yield Finding("error", "joint_damping", message, joint, value, REFUSED_ABOVE)
    else:
        calm = timestep * WARNED_ABOVE / value
        message = f"{what}, where the velocity changes sign from step to step; below {calm:.2g} s it does not"
        yield Finding("warning", "joint_damping", message, joint, value, WARNED_ABOVE)
