"""Robot descriptions, models, sample policies and motions, found with `asset_path`."""

from __future__ import annotations

from pathlib import Path

if __name__ != "humanoid_sim.assets":
    raise ImportError("import this package as 'humanoid_sim.assets', not as 'assets'")

__all__ = ["ASSETS", "asset_path"]

ASSETS = Path(__file__).parent


def asset_path(*parts: str) -> Path:
    """The path of a file or folder that ships with the package."""
    return ASSETS.joinpath(*parts)
