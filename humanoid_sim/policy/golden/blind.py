"""Which mistakes a checkpoint's golden vectors could not show: a run at heading 0 cannot tell world from body frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.terms import OrientationLayout, Term
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.golden.samples import GoldenSamples
from humanoid_sim.policy.golden.verify import golden_problem, samples_wiring

__all__ = ["blind_spots"]

_ZERO = 1e-6
"""Magnitude below which a term says nothing about its scale or its sign."""


def blind_spots(checkpoint: Checkpoint, samples: GoldenSamples) -> tuple[str, ...]:
    """Conventions that could be wrong without a difference in the samples, one line each.

    Every convention of every term is turned round in the contract, and the samples computed again: what still fits is
    not seen. The samples must fit the checkpoint as it is.
    """
    unseen = [
        what
        for what, contract in _mistakes(checkpoint.contract)
        if not golden_problem(replace(checkpoint, contract=contract), samples)
    ]
    unseen += _silent_terms(checkpoint, samples)
    if samples.target_origin == "own":
        unseen.append("action scale, offset and clip: the samples hold no targets of the trainer's")
    if not np.isnan(samples.alignment).all():
        unseen.append("align_reference: the samples hold the alignment itself")
    return (*unseen, "joint_stiffness, joint_damping and policy_dt: nothing in a sample depends on them")


def _mistakes(contract: PolicyContract) -> Iterator[tuple[str, PolicyContract]]:
    terms = contract.terms
    for i, term in enumerate(terms):
        for what, changes in _turned(term, contract):
            observation = (*terms[:i], replace(term, **changes), *terms[i + 1 :])
            yield f"{term.name}: {what}", replace(contract, observation=observation)


def _turned(term: Term, contract: PolicyContract) -> Iterator[tuple[str, dict[str, Any]]]:
    """The other choices of each convention that matters for the term."""
    kind = "motion_command" if term.kind == "command" and "motion" in contract.command_names else term.kind
    if kind in ("base_ang_vel", "base_lin_vel", "motion_anchor_pos"):
        yield f"frame ({term.frame})", {"frame": "world" if term.frame == "body" else "body"}
    if kind in ("joint_pos", "motion_command"):
        relative = kind == "joint_pos" if term.relative is None else term.relative
        yield f"{'relative' if relative else 'absolute'} positions", {"relative": not relative}
    if kind == "motion_anchor_ori":
        for layout in get_args(OrientationLayout):
            if layout != term.layout:
                yield f"layout ({term.layout}, not {layout})", {"layout": layout}
        yield "direction of the rotation", {"inverse": not term.inverse}
    if kind == "imu_quaternion":
        yield f"order ({term.quaternion})", {"quaternion": "xyzw" if term.quaternion == "wxyz" else "wxyz"}
    if kind == "actions":
        yield f"form ({term.form})", {"form": "scaled" if term.form == "raw" else "raw"}
    if term.history > 1 and contract.history_layout == "per_term":
        other = "newest_first" if term.history_order == "oldest_first" else "oldest_first"
        yield f"history order ({term.history_order})", {"history_order": other}


def _silent_terms(checkpoint: Checkpoint, samples: GoldenSamples) -> list[str]:
    layout = samples_wiring(checkpoint, samples).layout
    owner = np.array([layout.locate(i).partition("[")[0] for i in range(layout.width)])
    silent = (np.abs(samples.observation) <= _ZERO).all(axis=0)
    return [
        f"{term.name}: scale and sign, it is zero in all samples"
        for term in layout.terms
        if np.all(silent, where=owner == term.name)
    ]
