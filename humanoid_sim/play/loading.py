"""Loads another policy into a run: proved in a process of its own, built off the loop, then followed by all parts."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.piano_score import PlayedKeys
from humanoid_sim.evaluation.tracking import AnchorErrors, TrackingErrors, errors_of_run
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play.plan import Plan
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.play.proof import Proof, Prover, parse_options
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest, zero_policy
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy, has_onnxruntime
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.loading import PreparedPolicy, considerate
from humanoid_sim.stack import policy_controller, recorded_contract, recorded_motion

if TYPE_CHECKING:
    from humanoid_sim.play.assembly import Run


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPolicy:
    """Parts of a run's figures and its video that belong to the policy; all None without one."""

    tracking: TrackingErrors | None = None
    anchor: AnchorErrors | None = None
    goals: npt.NDArray[np.floating] | None = None
    """Shape (F, 88), 1 where a piano's key should be down."""
    keys: PlayedKeys | None = None
    ghost: ReferenceGhost | None = None

    @classmethod
    def of(cls, description: RobotDescription, policy: PolicyChoice, *, is_drawn: bool) -> JudgedPolicy:
        """Prepare to judge a policy; `is_drawn`: the run makes a video."""
        loaded, motion = policy.loaded, policy.motion
        if loaded is None:
            return cls()
        tracking, anchor = errors_of_run(description, loaded, motion)
        goals = motion.frames if motion is not None and motion.task_type == "piano" else None
        keys = None if goals is None else PlayedKeys(goals, loaded.contract.policy_dt)
        ghost = ReferenceGhost.of(description, loaded.contract, loaded.reference) if is_drawn else None
        return cls(tracking, anchor, goals, keys, ghost)


class PolicyLoader:
    """Prepares policies for `Loading`; of what it gives, only `follow` runs on the control thread."""

    def __init__(self, plan: Plan, header: SessionHeader) -> None:
        """Know the run.

        Args:
            plan: of the run.
            header: as recorded.
        """
        self._plan, self._header = plan, header
        self._prover = Prover()
        has_onnxruntime()  # imported now: later the import would stop the loop for 30 ms
        self.run: Run | None = None
        """Run whose parts follow the policy; set once it is put together."""

    def cancel(self) -> None:
        """End the process that proves a policy."""
        self._prover.cancel()

    def prepare(self, options: str) -> PreparedPolicy:
        """Check, prove and build a policy.

        Args:
            options: as `parse_options` takes them.

        Raises:
            InputError: the session cannot take it, and why.
        """
        run, plan = self.run, self._plan
        assert run is not None  # requests come by ticks
        proof = self._prover.prove(parse_options(options, plan.config), self._header)
        with considerate():
            policy = _policy_of(proof, plan)
            assert policy.loaded is not None
            contract = policy.loaded.contract
            controller = policy_controller(
                plan.description,
                plan.control_period,
                replace(policy.loaded, policy=plan.injector.policy(policy.loaded.policy)),
                live=proof.live,
                action_limit=proof.config.action_limit,
            )
            judged = JudgedPolicy.of(plan.description, policy, is_drawn=run.video is not None)
            measure = plan.setup.measure(contract)
            described = run.ends.feed.prepare(proof.header, proof.taken)

        def follow() -> None:
            self._header = proof.header
            measure()
            plan.velocity.begin(proof.command, contract.command_ranges, is_observed=policy.walks)
            run.ends.data.follow(plan.velocity if policy.walks else None, proof.taken, contract.live_timeouts)
            run.ends.feed.follow(described)
            run.follow(policy, proof.config, judged)

        motion = "" if policy.motion_file is None else f", motion {policy.motion_file.name}"
        text = "; ".join((f"policy loaded: {policy.source}{motion}", *filter(None, proof.notices)))
        return PreparedPolicy(
            controller,
            proof.header,
            text,
            follow,
            announce=lambda: run.ends.rename_policy(policy.source),
            discard=lambda: os.close(described),
        )


def _policy_of(proof: Proof, plan: Plan) -> PolicyChoice:
    """Return the policy that was proved, in this process: its network anew, everything else as it will be recorded."""
    contract, motion = recorded_contract(proof.header), recorded_motion(proof.header)
    assert contract is not None
    network: Policy = zero_policy(contract.action_count)
    if proof.sha256:
        path = Path(proof.source)
        model = OnnxModel(path)
        if plan.config.hardware is not None:  # a fault, and so DAMPING, while the motors still listen
            model.time_limit = 0.5 * plan.config.can_timeout
        network = policy = OnnxPolicy(model, contract.tensors)
        policy(np.zeros(policy.observation_width, dtype=np.float32), 0)
        if file_digest(path) != proof.sha256:
            raise InputError(f"{path}: has changed while it was checked")
    checkpoint = Checkpoint(contract, network, proof.source, proof.sha256)
    file = None if proof.motion_file is None else Path(proof.motion_file)
    return PolicyChoice(load_policy(contract, network, motion), checkpoint, motion, file)
