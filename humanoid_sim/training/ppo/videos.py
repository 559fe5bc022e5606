"""Videos of a policy that is being trained: every so often `play`, in a process of its own, with what it is then."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from pathlib import Path

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.learner import Learner
from humanoid_sim.training.ppo.network import write_network
from humanoid_sim.training.ppo.subject import Subject

__all__ = ["Videos"]

_SECONDS = 8.0
"""s of a policy that follows no motion."""
_SHARE = 0.5
"""Of each component's greatest command, in the video of a policy that walks: forward only."""
_ENDS_WITHIN = 60.0
"""s that a video has to become ready when the training is over."""


class Videos:
    """Starts `play` when it is time and the last one has ended."""

    def __init__(self, subject: Subject, folder: Path, minutes: float | None) -> None:
        """Make none before so many minutes; None: none at all."""
        self._subject, self._folder = subject, folder / "videos"
        self._period = float("inf") if minutes is None else 60.0 * minutes
        self._due = time.monotonic() + self._period
        self._process: subprocess.Popen[bytes] | None = None
        if minutes is not None:
            try:
                self._folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"{self._folder}: cannot be made a folder: {error.strerror}") from None

    def show(self, learner: Learner, steps: int) -> None:
        """Make one, if it is time."""
        if time.monotonic() < self._due or (self._process is not None and self._process.poll() is None):
            return
        self._due = time.monotonic() + self._period
        policy = self._folder / f"{steps:010d}.onnx"
        write_network(policy, learner.network(), self._subject.contract, policy.stem)
        self._process = subprocess.Popen(
            self.command(policy), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def command(self, policy: Path) -> list[str]:
        """What is run."""
        subject = self._subject
        words = ["--policy", str(policy), "--robot", subject.robot, "--video", str(policy.with_suffix(".mp4"))]
        words += ["--viewer", "none", "--pace", "fast", "--overwrite"]
        if subject.motion is not None:
            words += ["--motion", subject.motion]
        else:
            words += ["--policy-seconds", f"{_SECONDS:g}"]
        ranges = subject.contract.command_ranges
        if subject.scenario.wiring.takes_velocity_command and ranges is not None:
            words.append(f"--command={_SHARE * ranges[0, 1]:g},0,0")
        return [sys.executable, "-m", "humanoid_sim.play", *words]

    def close(self) -> None:
        """Wait for the one that is being made."""
        if self._process is None:
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
