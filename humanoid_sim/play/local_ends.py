"""The two ends by which other programs take part in a run: its feed and its intake, and the front ends it starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from humanoid_sim.frontends.launcher import FrontEnds
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play.plan import Plan
from humanoid_sim.recording.shadow import shadow_width
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import MODEL_BLOB, FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.loading import Loading
from humanoid_sim.session.outside_safety import OutsideSafety, parse_watchdogs
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.sources import RemoteInbox
from humanoid_sim.simulation.model import model_bytes


class LocalEnds:
    """Open from here on: intents that come before the first tick wait for it."""

    def __init__(
        self,
        plan: Plan,
        header: SessionHeader,
        reactivation: Reactivation,
        loading: Loading | None,
        *,
        show: Callable[[str], None],
        note: Callable[[str], None],
        is_ending: Callable[[], bool],
    ) -> None:
        """Open the sockets, make the feed, and let others find the session.

        Args:
            plan: of the run.
            header: of the run, as recorded.
            reactivation: what `reactivate` asks for.
            loading: what `load` asks for; None where no policy can be loaded.
            show: shows operators a line.
            note: records a line.
            is_ending: whether the session need not begin any more.

        Raises:
            InputError: if one of them cannot be had; nothing stays open then.
        """
        self._plan = plan
        self.shadow_figures: Callable[[], Mapping[str, Any]] | None = None
        """What is told of a shadow policy; None without one."""
        description, policy = plan.description, plan.policy
        with ExitStack() as stack:
            registration = Registration()
            stack.callback(registration.close)
            self.safety = OutsideSafety(parse_watchdogs(plan.config.watchdog))
            self.intents = IntentSocket(registration.intents, reactivation, note, self.safety, loading)
            stack.callback(self.intents.close)
            self.inbox = RemoteInbox(description.joint_names, plan.clock)
            self.data = DataSocket(
                registration.data,
                self.inbox,
                1e-3 * description.remote_policy_controller.stale_command_timeout_ms,
                clock=plan.clock,
                velocity=plan.velocity if policy.walks else None,
                live=plan.taken,
                timeouts=None if policy.contract is None else policy.contract.live_timeouts,
                tell=note,
            )
            stack.callback(self.data.close)
            width = 0 if plan.shadow is None or policy.loaded is None else shadow_width(policy.loaded)
            blobs = {MODEL_BLOB: model_bytes(plan.setup.model())}
            self.feed = FeedWriter(header, blobs, plan.taken, shadow_width=width)
            stack.callback(self.feed.close)
            self.front_ends = FrontEnds(
                plan.front_ends, self.feed, show=show, note=note, status=self._status, is_ending=is_ending
            )
            stack.callback(self.front_ends.close)
            registration.register(
                robot=description.name,
                policy=f"{'' if plan.shadow is None else 'shadow '}{policy.source}",
                hardware=plan.config.hardware or "",
                feed=self.feed.path,
            )
            self.rename_policy = registration.rename_policy
            self._close = stack.pop_all()

    def close(self) -> None:
        """Close whatever is still open. May be called twice."""
        self._close.close()

    def _status(self) -> Mapping[str, Any]:
        return {
            **self.data.status(),
            "front_ends": dict(self.front_ends.running),
            "robot": self._plan.setup.figures(),
            "shadow": None if self.shadow_figures is None else dict(self.shadow_figures()),
        }
