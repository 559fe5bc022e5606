"""Parts of a run's figures and its video that belong to its policy."""

from __future__ import annotations

from dataclasses import dataclass

from humanoid_sim.evaluation.piano_score import PlayedKeys
from humanoid_sim.evaluation.run_figures import MotionErrors
from humanoid_sim.mit import KEY_PRESSED, MITState
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPolicy:
    """Parts of a run's figures and pictures that belong to the policy; all None without one."""

    tracking: MotionErrors | None = None
    keys: PlayedKeys | None = None
    ghost: ReferenceGhost | None = None

    @classmethod
    def of(cls, description: RobotDescription, policy: PolicyChoice, *, is_drawn: bool) -> JudgedPolicy:
        """Prepare to judge a policy, if it is the only one; `is_drawn`: the run makes a page or a video."""
        loaded, motion = policy.loaded, policy.motion
        if loaded is None or policy.others:
            return cls()
        keys = None
        if motion is not None and motion.task_type == "piano":
            keys = PlayedKeys(motion.frames, loaded.contract.policy_dt)
        ghost = ReferenceGhost.of(description, loaded.contract, loaded.reference) if is_drawn else None
        return cls(MotionErrors.of(description, loaded), keys, ghost)

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of a policy step with the frame that the policy was shown."""
        if self.tracking is not None:
            self.tracking.update(frame, state)
        live = state.extern.get(KEY_PRESSED)
        if self.keys is not None and live is not None:
            self.keys.update(frame, live.value)
