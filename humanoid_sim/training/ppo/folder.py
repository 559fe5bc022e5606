"""Folder of a run: what it is a run of, and its checkpoint."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, whole_file
from humanoid_sim.strict_json import parse_json
from humanoid_sim.training.ppo.learner import PPOSettings
from humanoid_sim.training.ppo.options import TrainConfig

_MAY_DIFFER = (
    *("steps", "minutes", "folder", "output", "resume", "checkpoint_seconds", "video_minutes", "tensorboard"),
    *("regress", "threads"),
)
_KEPT = ("curriculum_steps",)
"""Options that a run goes on with as they were, unless others are given, which are refused."""
_PPO = "ppo"


class RunFolder:
    """Folder of a run: `run.json`, which says what it is a run of, and its checkpoint."""

    def __init__(
        self, path: Path, config: TrainConfig, subject: Mapping[str, Any], settings: PPOSettings, suffix: str
    ) -> None:
        """Begin a run, or find the checkpoint of the one to resume.

        Args:
            subject: what options came to that name a file, a class or a default, by option, as plain values.

        Raises:
            InputError: it cannot be made, it has a checkpoint that is not to be resumed, or one of another run.
        """
        self.path, self.checkpoint = path, path / f"checkpoint{suffix}"
        self._place = path / "run.json"
        options = {name: value for name, value in asdict(config).items() if name not in _MAY_DIFFER}
        # as JSON has it
        self._run: dict[str, Any] = json.loads(json.dumps({**options, **subject, _PPO: asdict(settings)}))
        self.is_resumed = is_file(self._place)
        if self.is_resumed:
            self._check(config.resume)
        elif config.resume:
            raise InputError(f"--resume: '{path}' has no run to go on with, expected a folder of `train`")
        else:
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"--folder: '{path}' cannot be made a folder: {error.strerror}") from None
            with whole_file(self._place) as file:
                file.write(json.dumps(self._run, indent=1).encode())
        self.curriculum_steps: int | None = self._run["curriculum_steps"]
        """Policy steps after which the curriculum's progress is 1; None: there is no curriculum."""

    @property
    def start(self) -> Path | None:
        """The checkpoint to go on from; None at the beginning, also of a run that ended before its first."""
        return self.checkpoint if self.is_resumed and is_file(self.checkpoint) else None

    def _check(self, resume: bool) -> None:
        if not resume:
            raise InputError(f"--folder: '{self.path}' has a run; --resume goes on with it, another folder begins")
        try:
            known = parse_json(self._place.read_bytes())
        except (OSError, ValueError) as error:
            raise InputError(f"{self._place}: cannot be read: {error}") from None
        for name, value in self._run.items():
            before = known.get(name) if isinstance(known, dict) else None
            if name in _KEPT and value is None:
                self._run[name] = before
            elif before != value:
                option = "PPO's settings" if name == _PPO else f"--{name.replace('_', '-')}"
                raise InputError(
                    f"{option}: is {value!r}, but the run in '{self.path}' has {before!r}; --resume keeps it"
                )
