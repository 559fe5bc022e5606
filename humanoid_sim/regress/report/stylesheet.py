"""The page's style sheet."""

from __future__ import annotations

from collections.abc import Mapping

from humanoid_sim.regress.report.palette import COLOURS, DARK

__all__ = ["stylesheet"]

_RULES = """
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 70rem; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.5rem; margin: 0; }
h2 { font-size: 1.15rem; margin: 2.5rem 0 0.75rem; padding-top: 0.75rem; border-top: 1px solid var(--grid); }
h3 { font-size: 1rem; margin: 1.5rem 0 0.25rem; }
.lead { font-size: 1.05rem; }
.verdict { display: inline-block; padding: 0.1rem 0.7rem; margin-bottom: 0.4rem; border-radius: 0.3rem;
  color: var(--paper); font-weight: 700; letter-spacing: 0.06em; }
.verdict.worse { background: var(--worse); }
.verdict.better { background: var(--better); }
.note, .faint, figcaption { color: var(--faint); }
.note, figcaption { font-size: 0.88rem; max-width: 60rem; }
figcaption b { color: var(--ink); }
figure { margin: 0.75rem 0 1.25rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 0.92rem; }
th, td { padding: 0.35rem 0.6rem; text-align: left; border-bottom: 1px solid var(--grid); vertical-align: middle; }
th { color: var(--faint); font-weight: 600; font-size: 0.82rem; white-space: nowrap; }
.number { text-align: right; white-space: nowrap; }
td span[title] { border-bottom: 1px dotted var(--faint); cursor: help; }
code { font: 0.9em ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
svg { display: block; width: 100%; height: auto; }
svg text { font-family: system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
svg.bar { width: 190px; height: 22px; }
.badge { display: inline-block; padding: 0 0.5rem; border-radius: 0.7rem; font-size: 0.82rem; font-weight: 600;
  border: 1px solid var(--grid); color: var(--faint); }
.badge.worse { background: var(--worse); border-color: var(--worse); color: var(--paper); }
.badge.better { border-color: var(--better); color: var(--better); }
.badge.unclear { border-color: var(--unclear); color: var(--unclear); }
details { margin: 1rem 0; }
summary { cursor: pointer; color: var(--faint); }
@media print { details:not([open]) > *:not(summary) { display: block; } body { max-width: none; } }
"""


def stylesheet() -> str:
    """The rules, with the colours of light and of dark systems as variables."""
    return f":root {_variables(COLOURS)}\n@media (prefers-color-scheme: dark) {{ :root {_variables(DARK)} }}{_RULES}"


def _variables(colours: Mapping[str, str]) -> str:
    return "{ " + " ".join(f"--{name}: {colour};" for name, colour in colours.items()) + " }"
