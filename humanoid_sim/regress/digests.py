"""What an episode depends on, as digests: results are compared only where these are equal."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from humanoid_sim.policy.motion import Motion
from humanoid_sim.regress.suite import Case, Suite
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["case_digest"]

_JUDGING = ("seeds", "first_seed", "tolerances", "confidence", "resamples", "margins")
_NAMES = ("name", "summary", "robot", "cases")
_INCLUDE = re.compile(rb"<include\s[^>]*file\s*=\s*[\"']([^\"']+)[\"']")


def case_digest(suite: Suite, case: Case, motion: Motion | None, description: RobotDescription) -> str:
    """SHA-256 of the suite's conditions, the case, its motion, and the robot with its MJCF.

    Neither names for people nor what only the judging depends on takes part, nor the motion that is in a policy.
    """
    conditions: dict[str, Any] = msgspec.to_builtins(suite)
    for name in (*_JUDGING, *_NAMES):
        del conditions[name]
    document = {
        "conditions": conditions,
        "case": {**msgspec.to_builtins(case), "motion": bool(case.motion)},
        "robot": description.to_json(),
    }
    digest = hashlib.sha256(msgspec.json.encode(document, order="deterministic"))
    if motion is not None:
        digest.update(motion.frames.tobytes())
    for text in _mjcf(description.mjcf_path):
        digest.update(text)
    return digest.hexdigest()


def _mjcf(path: Path, depth: int = 8) -> Iterator[bytes]:
    """The text of an MJCF and of what it includes; meshes do not take part."""
    if depth and path.is_file():
        text = path.read_bytes()
        yield text
        for name in _INCLUDE.findall(text):
            yield from _mjcf(path.parent / name.decode(errors="replace"), depth - 1)
