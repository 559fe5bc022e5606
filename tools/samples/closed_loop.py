"""Second part of training: back-propagation through the closed loop of policy and arm.

The arm is linearised along each training motion: with the exact command u* (see `teacher.py`) the error state
x = (q - q_ref, qd - qd_ref) stays zero, and near it

    x' = A x + B (u - u*),   A, B from  M δqdd = K_p (δu - δq) - K_d δqd   over half a policy step.

This is cheap, exact to first order, and differentiable, so that a window of policy steps can be unrolled and the
tracking error itself minimised: no labels, no value function. Gains, inertia, sensor noise and joint offsets differ
between the simulated arms, commands come up to half a policy step late, and states up to a whole one, as on a bus that
is asked once per step. What the linear model leaves out (Coriolis forces between
small errors, saturation, stiction) is left to the evaluation, which runs the whole stack in MuJoCo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from humanoid_sim.mit import FloatArray
from tools.samples import scales
from tools.samples.arm import ARM_JOINTS
from tools.samples.motions import POLICY_DT
from tools.samples.statics import PoseBatches, patient, quadratic, soft, tensor
from tools.samples.student import ArmNetwork
from tools.samples.teacher import TrainingMotions

__all__ = ["ClosedLoop", "WindowCost", "linearise", "train_closed_loop"]

_SMOOTHNESS = 30.0
"""1/rad²: cost of commands that change from step to step otherwise than u* does."""
_HASTE = 0.5
"""s²/rad²: cost of joint speed beyond the reference's by more than `_TOLERATED_SPEED`: no lashing out after a jump."""
_TOLERATED_SPEED = 2.0
"""rad/s"""
_GEOMETRY_SHARE = 0.3
"""Weight of the static poses, which keep what the first part learned all over the workspace."""
_LOST = 20.0
"""rad or rad/s: beyond this an arm starts anew."""


def linearise(mass: FloatArray, stiffness: FloatArray, damping: FloatArray, period: float) -> tuple[Tensor, Tensor]:
    """Return the error dynamics over `period` seconds: A (F, 14, 14) and B (F, 14, 7).

    Args:
        mass: shape (F, 7, 7), kg·m².
        stiffness: shape (F, 7), N·m/rad.
        damping: shape (F, 7), N·m·s/rad.
        period: s
    """
    n = ARM_JOINTS
    inverse = np.linalg.inv(mass)
    rate = np.zeros((len(mass), 2 * n, 2 * n))
    rate[:, :n, n:] = np.eye(n)
    rate[:, n:, :n] = -inverse * stiffness[:, None]
    rate[:, n:, n:] = -inverse * damping[:, None]
    flow = torch.cat([torch.linalg.matrix_exp(part) for part in torch.split(tensor(rate * period), 16384)])
    # An arm that rests at its command stays there: A [u, 0] + B u = [u, 0] for every u.
    drive = -flow[:, :, :n]
    drive[:, :n] += torch.eye(n)
    return flow, drive


@dataclass(frozen=True, slots=True)
class WindowCost:
    """Mean costs over a window of policy steps."""

    tracking: Tensor
    smoothness: Tensor
    haste: Tensor


class ClosedLoop:
    """E arms that follow motions under the policy, in steps of `POLICY_DT`."""

    def __init__(self, motions: TrainingMotions, default: Tensor, arms: int, generator: torch.Generator) -> None:
        self._default, self._generator = default, generator
        self._position = tensor(motions.body_position)
        self._columns = tensor(motions.body_rotation[..., :2])
        self._reference = tensor(motions.joint_position) - default
        self._reference_velocity = tensor(motions.joint_velocity)
        self._weight = tensor(motions.weight)
        self._command = tensor(motions.command) - default
        self._sag = tensor(motions.sag)
        count, steps = motions.command.shape[:2]
        stiffness, damping = (
            np.repeat(gains, steps, axis=0) for gains in (motions.plants.stiffness, motions.plants.damping)
        )
        flow, drive = linearise(motions.mass.reshape(-1, ARM_JOINTS, ARM_JOINTS), stiffness, damping, 0.5 * POLICY_DT)
        self._flow = flow.reshape(count, steps, *flow.shape[1:])
        self._drive = drive.reshape(count, steps, *drive.shape[1:])
        self._count, self._steps = count, steps

        self._motion = torch.zeros(arms, dtype=torch.long)
        self._frame = torch.zeros(arms, dtype=torch.long)
        self._error = torch.zeros(arms, 2 * ARM_JOINTS)
        self._last_action = torch.zeros(arms, ARM_JOINTS)
        self._delay = torch.zeros(arms, 1)
        self._offset = torch.zeros(arms, ARM_JOINTS)
        self._noise = torch.zeros(arms, 1)
        self._age = torch.zeros(arms, 1)
        self._started = False

    def run(self, network: ArmNetwork, window: int) -> WindowCost:
        """Unroll the loop over a window, from where the last one ended; arms at the end of their motion start anew."""
        is_lost = self._error.abs().amax(dim=1) > _LOST
        at_end = self._frame + window >= self._steps
        stale = is_lost | at_end | (self._uniform(len(self._frame)) < 0.1)
        self._restart(torch.nonzero(stale if self._started else torch.ones_like(stale)).flatten(), network, window)
        self._started = True

        scale = scales.ACTION
        where = self._motion[:, None], self._frame[:, None] + torch.arange(window)
        target = network.target(self._position[where], self._columns[where])
        reference, velocity = self._reference[where], self._reference_velocity[where]
        exact, weight = self._command[where], self._weight[where]
        flow, drive = self._flow[where], self._drive[where]
        error, action = self._error, self._last_action
        lead, tracking, smoothness, haste = None, [], [], []
        previous: Tensor | None = None
        for step in range(window):
            tracking.append(quadratic(error[:, :ARM_JOINTS], weight[:, step]))
            haste.append((error[:, ARM_JOINTS:].abs() - _TOLERATED_SPEED).clamp(min=0.0).square().sum(dim=1))
            state = torch.cat([reference[:, step], velocity[:, step]], dim=1) + error
            # An old state lies between this step's and the last one's.
            seen = state if previous is None else state + self._age * (previous - state)
            previous = state
            joints = seen[:, :ARM_JOINTS] + self._offset + 0.002 * self._noise * self._normal(self._offset.shape)
            speed = seen[:, ARM_JOINTS:] + 0.05 * self._noise * self._normal(self._offset.shape)
            before = action * scale - exact[:, step]
            action = network(target.at(step), joints, speed, action)
            now = action * scale - exact[:, step]
            if lead is not None:
                smoothness.append((now - lead).square().sum(dim=1))
            lead = now
            # A late command: for part of the first half of the step the one before is still in force.
            late = self._delay * before + (1.0 - self._delay) * now
            for push in (late, now):
                error = (flow[:, step] @ error[..., None] + drive[:, step] @ push[..., None])[..., 0]
        self._error, self._last_action = error.detach(), action.detach()
        self._frame = self._frame + window
        return WindowCost(
            tracking=patient(torch.stack(tracking)).mean(),
            smoothness=torch.stack(smoothness).clamp(max=1.0).mean(),
            haste=soft(torch.stack(haste), 25.0).mean(),
        )

    def _restart(self, arms: Tensor, network: ArmNetwork, window: int) -> None:
        """Put arms at a frame of a motion: following it, disturbed, or at rest elsewhere as after standby."""
        count = len(arms)
        if not count:
            return
        motion = torch.randint(self._count, (count,), generator=self._generator)
        frame = torch.randint(self._steps - window, (count,), generator=self._generator)
        frame = torch.where(self._uniform(count) < 0.3, 0, frame)
        reference, velocity = self._reference[motion, frame], self._reference_velocity[motion, frame]
        sag, scale = self._sag[motion, frame], scales.ACTION

        disturbed = self._uniform(count, 1) < 0.5
        position_error = torch.where(disturbed, 0.05 * self._normal((count, ARM_JOINTS)), 0.0)
        position_error -= sag * self._uniform(count, 1)
        velocity_error = torch.where(disturbed, 0.3 * self._normal((count, ARM_JOINTS)), 0.0)
        action = self._command[motion, (frame - 1).clamp(min=0)] / scale

        # At rest under a held command, up to half a radian from the frame: a jump.
        jumps = self._uniform(count, 1) < 0.1
        held = reference + 0.3 * self._normal((count, ARM_JOINTS))
        # In pose A after standby, where the controller starts with no action.
        near = reference.abs().amax(dim=1, keepdim=True)
        stands = (near < 0.01) & (frame == 0)[:, None] | (near < 0.6) & (self._uniform(count, 1) < 0.5)
        held = torch.where(stands, 0.0, held)
        rests = jumps | stands
        self._error[arms] = torch.cat(
            [
                torch.where(rests, held - sag - reference, position_error),
                torch.where(rests, -velocity, velocity_error),
            ],
            dim=1,
        )
        self._last_action[arms] = torch.where(rests, held / scale, action)
        self._motion[arms], self._frame[arms] = motion, frame
        self._delay[arms] = self._sometimes(0.5, self._uniform(count, 1))
        self._offset[arms] = self._sometimes(0.5, 0.01 * self._normal((count, ARM_JOINTS)))
        self._age[arms] = self._sometimes(0.4, self._uniform(count, 1))
        self._noise[arms] = self._sometimes(0.6, self._uniform(count, 1))

    def _sometimes(self, share: float, values: Tensor) -> Tensor:
        """Return a random share of the rows of values (k, ...); zeros for the others."""
        return torch.where(self._uniform(len(values), 1) < share, values, 0.0)

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self._generator)

    def _normal(self, shape: tuple[int, ...]) -> Tensor:
        return torch.randn(shape, generator=self._generator)


def train_closed_loop(
    network: ArmNetwork,
    loop: ClosedLoop,
    poses: PoseBatches,
    steps: int,
    *,
    window: int = 40,
    learning_rate: float = 2e-3,
    report: Callable[[int, float], None],
) -> None:
    """Train in place; `report` gets the number of updates done and the present tracking cost."""
    optimizer = torch.optim.AdamW(network.parameters(), learning_rate, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, learning_rate, steps, pct_start=0.1)
    recent: list[float] = []
    for step in range(steps):
        cost = loop.run(network, window)
        geometry, _ = poses.cost(network, 1024, with_hold=False)
        loss = cost.tracking + _SMOOTHNESS * cost.smoothness + _HASTE * cost.haste + _GEOMETRY_SHARE * geometry
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        recent = [*recent[-24:], cost.tracking.item()]
        report(step + 1, float(np.mean(recent)))
