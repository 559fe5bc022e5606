"""Names of a policy's values, for plots: joints where a value is of one, components of vectors, else numbers."""

from __future__ import annotations

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout, ObservationTerm

_AXES = ("x", "y", "z")


def observation_labels(contract: PolicyContract, layout: ObservationLayout) -> dict[str, tuple[str, ...]]:
    """By term the name of each of its values, all steps of its history together.

    A term whose values do not lie together, as in observations that are laid out step by step, has numbers.
    """
    is_scattered = layout.history_layout == "per_step" and layout.history > 1
    return {
        term.name: tuple(str(i) for i in range(term.width)) if is_scattered else _with_history(contract, term)
        for term in layout.terms
    }


def _with_history(contract: PolicyContract, term: ObservationTerm) -> tuple[str, ...]:
    names = _step(contract, term)
    steps = range(term.term.history)
    if len(steps) == 1:
        return names
    ages = reversed(steps) if term.term.history_order == "oldest_first" else steps
    return tuple(f"{name}, {age} steps ago" if age else name for age in ages for name in names)


def _step(contract: PolicyContract, term: ObservationTerm) -> tuple[str, ...]:
    """Return the labels of one step."""
    width = term.stop - term.start
    kind = contract.kind(term.term)
    joints = kind.value_names(term.term, contract)
    if len(joints) == width:
        half = width // 2
        if len(set(joints)) == half:  # a motion's joint positions, then their velocities
            return tuple(f"{joint} {'position' if i < half else 'velocity'}" for i, joint in enumerate(joints))
        return joints
    bodies = contract.body_names
    if kind.name.startswith("motion_body") and bodies and width % len(bodies) == 0:
        size = width // len(bodies)
        return tuple(f"{body} {part}" for body in bodies for part in _components(size))
    return tuple(_components(width, quaternion=term.term.quaternion))


def _components(count: int, quaternion: str = "wxyz") -> tuple[str, ...]:
    """Return the labels of a vector or a quaternion; numbers of anything else."""
    if count == len(_AXES):
        return _AXES
    return tuple(quaternion) if count == 4 else tuple(str(i) for i in range(count))
