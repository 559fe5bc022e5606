"""The report of a fit as one HTML file that loads nothing: tables, and measured against predicted as SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from humanoid_sim.regress.report.plots import COLOURS, LIGHT, SETTINGS
from humanoid_sim.sysid.judgement import Judgement

_WIDTH, _ROW = 11.1, 1.5
"""Inches of the picture, and of the height of one joint in it."""


def page(results: Mapping[str, Any], judgement: Judgement, joint_names: Sequence[str]) -> str:
    """Return the page, as HTML."""
    environment = Environment(
        loader=PackageLoader("humanoid_sim.sysid", "."), autoescape=True, trim_blocks=True, undefined=StrictUndefined
    )
    with mpl.rc_context(SETTINGS):
        plot = _plot(judgement, joint_names)
    return environment.get_template("page.html").render(results=results, colours=COLOURS, plot=plot)


def _plot(judgement: Judgement, joint_names: Sequence[str]) -> str:
    window, old, new = judgement.shown
    rows = slice(window.first, window.last)
    time = window.run.time[rows]
    figure = Figure(figsize=(_WIDTH, _ROW * len(joint_names)), layout="constrained")
    axes = figure.subplots(len(joint_names), 2, sharex=True, squeeze=False)
    for j, (name, (whole, error)) in enumerate(zip(joint_names, axes, strict=True)):
        measured = window.run.position[rows, j]
        whole.plot(time, measured, color=LIGHT["ink"], linewidth=1.6)
        whole.set_ylabel(f"{name}, rad", fontsize=7.0)
        for prediction, colour in ((old, LIGHT["baseline"]), (new, LIGHT["candidate1"])):
            whole.plot(time, prediction.position[:, j], color=colour, linewidth=0.8)
            error.plot(time, 1e3 * (prediction.position[:, j] - measured), color=colour, linewidth=0.8)
        limit = 1.1e3 * np.abs(old.position[:, j] - measured).max() + 1e-6
        error.set_ylim(-limit, limit)
    for axis in axes[-1]:
        axis.set_xlabel("s")
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()[text.getvalue().index("<svg") :]
    for meaning, light in LIGHT.items():  # of the page's light or dark scheme
        svg = re.sub(re.escape(light), f"var(--{meaning})", svg, flags=re.IGNORECASE)
    return svg
