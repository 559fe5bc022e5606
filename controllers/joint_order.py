"""Match joints by name."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError, known_names

__all__ = ["joint_indices"]


def joint_indices(wanted: tuple[str, ...], available: tuple[str, ...], what: str) -> npt.NDArray[np.intp]:
    """Positions of the `wanted` joints among the `available` ones.

    Raises:
        FieldError: naming the joint that is missing and those that exist.
    """
    place = {name: i for i, name in enumerate(available)}
    for name in wanted:
        if name not in place:
            raise FieldError(f"{known_names('joint', name, available)} ({what})")
    indices = np.array([place[name] for name in wanted], dtype=np.intp)
    indices.setflags(write=False)
    return indices
