"""Files that trainers write beside a model: where they lie, and what they have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.terms import term_kind
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file
from humanoid_sim.mit import HEIGHT_SCAN
from humanoid_sim.policy.words import shown

_SWITCHES: Mapping[str, Any] = MappingProxyType(
    {"use_gym_history": False, "scale_first": False, "history_length": None, "concatenate_terms": True}
)


def find_beside(checkpoint: Path, name: str) -> Path | None:
    """Give the file beside the model, in `params/` there, or in `params/` beside the folder `exported/` around it."""
    folder = checkpoint.absolute().parent
    places = [folder / name, folder / "params" / name]
    if folder.name == "exported":
        places.append(folder.parent / "params" / name)
    return next((place for place in places if is_file(place)), None)


def mapping(document: Any, where: str, *keys: str) -> Mapping[str, Any]:
    """Return the mapping at a place of a document; an empty one where there is none."""
    for key in keys:
        if document is None:
            break
        if not isinstance(document, dict):
            raise InputError(f"{where}: is {shown(document)}, expected a mapping")
        document, where = document.get(key), f"{where}.{key}"
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise InputError(f"{where}: is {shown(document)}, expected a mapping")
    return document


def number(value: Any, where: str) -> float:
    """Return a number of a document."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: is {shown(value)}, expected a number")
    return float(value)


def is_group(value: Any) -> bool:
    """Tell a group, which holds terms, that is mappings, from a term, which holds `params`, `scale` and the like."""
    if not isinstance(value, dict) or "func" in value:
        return False
    items = [item for key, item in value.items() if key not in (*_SWITCHES, "params", "noise", "func")]
    return any(isinstance(item, dict) for item in items)


def observation_fields(group: Mapping[str, Any], where: str) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a contract that an observation group of Isaac Lab's form gives, term by term."""
    switches = {name: group.get(name, usual) for name, usual in _SWITCHES.items()}
    terms = {str(name): term for name, term in group.items() if isinstance(term, dict)}
    commands = []
    for name, term in terms.items():
        place = f"{where}.{name}"
        if is_group(term):
            raise InputError(f"{where}: has the groups {', '.join(terms)}, expected one group of terms, for one input")
        function = str(term.get("func", "")).rpartition(":")[2].replace("generated_commands", "command")
        kind = term_kind(function if function and term_kind(name).meaning == "live input" else name)
        if kind.name != term_kind(name).name and kind.meaning != "live input":
            yield f"observation.{name}.kind", function
        if kind.name == "joint_pos" and function in ("joint_pos", "joint_pos_rel"):
            yield f"observation.{name}.relative", function == "joint_pos_rel"
        scale = 1.0 if term.get("scale") is None else term["scale"]
        yield f"observation.{name}.scale", scale
        if term.get("clip") is not None:
            yield f"observation.{name}.clip", _clip(term["clip"], scale, switches["scale_first"] is True, place)
        history = switches["history_length"] if switches["history_length"] is not None else term.get("history_length")
        # 0 stands for a term without a history: it shows the present step alone.
        yield f"observation.{name}.history", max(history or 1, 1) if isinstance(history, int | None) else history
        params = mapping(term, place, "params")
        if isinstance(params.get("command_name"), str):
            commands.append(params["command_name"])
        asset = mapping(params, place, "asset_cfg")
        if kind.reads.startswith("joint_") and asset.get("joint_ids") not in (None, slice(None)):
            yield f"observation.{name}.joints", asset["joint_ids"]
        if kind.requires == "phase" and params.get("period") is not None:
            yield "phase.period", number(params["period"], f"{place}.params.period")
    if terms:
        yield "observation", list(terms)
        yield "history_layout", "per_step" if switches["use_gym_history"] is True else "per_term"
    if commands:
        yield "command_names", list(dict.fromkeys(commands))


def joint_patterns(document: Any) -> Iterator[str]:
    """Yield the names and patterns of joints that any part of a file holds under `joint_names`."""
    for key, value in document.items() if isinstance(document, dict) else ():
        if key == "joint_names" and value is not None:
            yield from (str(item) for item in (value if isinstance(value, list) else [value]))
        else:
            yield from joint_patterns(value)


def _clip(clip: Sequence[float], scale: Any, scale_first: bool, where: str) -> list[float]:
    """Return the bounds of the value before it is scaled."""
    if not isinstance(clip, list | tuple) or len(clip) != 2:
        raise InputError(f"{where}.clip: is {shown(clip)}, expected [least, greatest]")
    if not scale_first:
        return list(clip)
    factors = set(scale) if isinstance(scale, list) else {scale}
    if len(factors) != 1 or not min(factors) > 0.0:
        raise InputError(
            f"{where}.scale: is {shown(scale)}, expected one positive factor, as scale_first clips after it"
        )
    return [bound / min(factors) for bound in clip]


def isaac_scans(group: Mapping[str, Any], where: str) -> Iterator[tuple[str, HeightScan]]:
    """Yield what a group's height scans are with Isaac Lab's scanner in unitree_rl_lab's scenes, which no file says.

    A ray (`RayCasterCfg`, `GridPatternCfg`) that hits nothing counts as endlessly high ground; the clip bounds it.
    """
    for name, term in group.items():
        if term_kind(str(name)).name == HEIGHT_SCAN and isinstance(term, dict):
            offset = mapping(term, f"{where}.{name}", "params").get("offset", 0.5)
            meters = number(offset, f"{where}.{name}.params.offset")
            yield f"observation.{name}.scan", HeightScan("torso_link", offset=meters, range=1e6, miss=-1e6, above=20.0)
