"""Environments that are pickled and deep-copied: built again from their arguments, then put into the same state.

What they hold beside their state (MuJoCo's threads, views into its memory, windows) cannot be copied, and need not be.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec


class CopyableEnv:
    """First base of an environment that can be copied in the middle of an episode; both then go on alike.

    A copy reads files that were named to the first one again, opens no window before it shows something, and is closed
    where the first one was.
    """

    KEPT: tuple[str, ...] = ()
    """Attributes that make up its state, beside those of `_snapshot`."""
    max_episode_steps: int
    """Steps after which every episode is truncated, if it is not over before."""
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]
    _given_spec: EnvSpec | None = None

    def __new__(cls, *arguments: Any, **options: Any) -> Self:
        """Remember what it is built from."""
        self = super().__new__(cls)
        self._arguments = arguments, options
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`."""
        arguments, options = self._arguments
        return partial(type(self), *arguments, **options), (), self.snapshot()

    def __setstate__(self, snapshot: dict[str, Any]) -> None:
        """For `pickle` and `copy`, of one that was just built."""
        self.restore(snapshot)

    @property
    def spec(self) -> EnvSpec | None:
        """Return what Gymnasium made it from, with the length of its episodes; None if it was built directly."""
        return self._given_spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=self.max_episode_steps)
        self._given_spec = spec

    def snapshot(self) -> dict[str, Any]:
        """Its present state, for `restore` of one that was built alike; shares arrays with it until it is pickled."""
        common = ("_np_random", "_np_random_seed", "_given_spec", "action_space", "observation_space", "fault_count")
        return {name: vars(self)[name] for name in (*common, *self.KEPT) if name in vars(self)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take over a state."""
        vars(self).update(snapshot)
