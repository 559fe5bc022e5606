"""Copies of a policy that are worse on purpose, and small networks of other shapes than exporters usually write."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper
from published import POLICIES

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.checkpoint import GOLDEN_KEY

__all__ = ["G1_SCENE", "G1_WALKER", "SAMPLE", "WALKER", "Walker", "failing_copy", "noisy_copy", "swapped_copy"]

SAMPLE = asset_path("policies", "lite_tracking.onnx")
EPISODE = 300
"""Policy steps of an episode of the suite `velocity`, of policies at 50 Hz."""


def noisy_copy(path: Path, output: Path, scale: float, seed: int = 0) -> Path:
    """Every weight multiplied by 1 + scale · N(0, 1)."""
    model = _load(path)
    generator = np.random.default_rng(seed)
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.name.endswith(".weight"):
            noisy = values * (1.0 + scale * generator.standard_normal(values.shape))
            tensor.CopyFrom(numpy_helper.from_array(noisy.astype(values.dtype), tensor.name))
    return _save(model, output)


def swapped_copy(path: Path, output: Path, first: int, second: int) -> Path:
    """Two of the action's values in each other's place."""
    model = _load(path)
    width = model.graph.output[0].type.tensor_type.shape.dim[1].dim_value
    order = np.arange(width)
    order[[first, second]] = second, first
    model.graph.initializer.append(numpy_helper.from_array(order, "swapped_order"))
    _behind_output(
        model, lambda source, target: helper.make_node("Gather", [source, "swapped_order"], [target], axis=1)
    )
    return _save(model, output)


def failing_copy(path: Path, output: Path, value: float = float("nan")) -> Path:
    """Every action plus a value: not a number, or beyond the limit."""
    model = _load(path)
    model.graph.initializer.append(numpy_helper.from_array(np.array([value], dtype=np.float32), "failing_value"))
    _behind_output(model, lambda source, target: helper.make_node("Add", [source, "failing_value"], [target]))
    return _save(model, output)


@dataclass(frozen=True)
class Walker:
    """A policy that walks, and copies of it that walk worse, each a function of the observation as the policy is."""

    path: Path
    command: int
    """Column of the observed vx; vy and the yaw rate follow."""
    action: int
    """Column of the first observed action of the step before."""
    joint: int
    """Number of an action that bends a knee."""
    contract: Path | None = None
    """File that a copy, in a folder `exported`, needs in the folder `params` beside that."""

    def slowed(self, output: Path, factor: float, *, only_backward: bool = False) -> Path:
        """Walks for `factor` times the command; or does so only where it is to walk backward."""
        add = _Addition(self)
        scale = np.ones(add.observed, dtype=np.float32)
        scale[self.command : self.command + 3] = factor
        if only_backward:
            is_backward = add("Less", add.column(self.command), np.float32([-0.1]))
            add("Where", is_backward, add("Mul", "obs_given", scale), "obs_given", output="obs_seen")
        else:
            add("Mul", "obs_given", scale, output="obs_seen")
        add("Identity", "answered", output="actions_sent")
        return add.save(output)

    def noisy(self, output: Path, share: float) -> Path:
        """Every action has Gaussian-sized noise, a share of its own magnitude."""
        add = _Addition(self)
        phases = np.linspace(1.0, 2.0, add.answered, dtype=np.float32)
        noise = add("Sin", add("Mul", add.hashed(0), phases))
        factor = add("Add", add("Mul", noise, np.float32([share * 2.0**0.5])), np.float32([1.0]))
        add("Mul", "answered", factor, output="actions_sent")
        return add.untouched().save(output)

    def chattering(self, output: Path, amplitude: float) -> Path:
        """One joint's action jumps up and down from step to step by an amplitude to each side."""
        add = _Addition(self)
        jump = np.zeros(add.answered, dtype=np.float32)
        jump[self.joint] = amplitude
        was_up = add("Greater", add.column(self.action + self.joint), add.column(self.joint, of="answered"))
        add("Add", "answered", add("Where", was_up, -jump, jump), output="actions_sent")
        return add.untouched().save(output)

    def falling(self, output: Path, share: float) -> Path:
        """A share of the episodes ends in a fall: at an instant that the noise of the sensors decides, a knee bends."""
        add = _Addition(self)
        rare = np.sqrt(1.0 - (1.0 - share) ** (1.0 / EPISODE))
        near = np.float32([np.cos(np.pi * rare)])  # a sine is above this for a share `rare` of the phases
        begins = add("And", *(add("Greater", add("Sin", add.hashed(seed)), near) for seed in (0, 1)))
        goes_on = add("Greater", add.column(self.action + self.joint), np.float32([50.0]))
        bend = np.zeros(add.answered, dtype=np.float32)
        bend[self.joint] = 60.0
        add("Where", add("Or", begins, goes_on), bend, "answered", output="actions_sent")
        return add.untouched().save(output)


WALKER = Walker(asset_path("policies", "lite_biped_velocity.onnx"), command=6, action=37, joint=3)
_G1 = POLICIES / "unitree_g1_velocity_v0"
G1_WALKER = Walker(_G1 / "exported" / "policy.onnx", 6, 67, 3, contract=_G1 / "params" / "deploy.yaml")
G1_SCENE = POLICIES / "models" / "unitree_g1" / "scene.xml"


class _Addition:
    """Nodes in front of a model, `obs_given` to `obs_seen`, and behind it, `answered` to `actions_sent`."""

    def __init__(self, walker: Walker) -> None:
        self.model, self._contract = _load(walker.path), walker.contract
        (source,), (sink,) = self.model.graph.input, self.model.graph.output
        self.observed, self.answered = (end.type.tensor_type.shape.dim[1].dim_value for end in (source, sink))
        self._ends = {"obs_given": source.name, "actions_sent": sink.name}
        inside = {source.name: "obs_seen", sink.name: "answered"}
        for node in self.model.graph.node:
            for names in (node.input, node.output):
                names[:] = [inside.get(name, name) for name in names]
        self._inner = list(self.model.graph.node)
        self._front: list[onnx.NodeProto] = []
        self._count = 0

    def __call__(self, operator: str, *inputs: str | np.ndarray, output: str = "", **attributes: int) -> str:
        """A node's output; arrays become constants."""
        names = [self._ends.get(value, value) if isinstance(value, str) else self._constant(value) for value in inputs]
        self._count += 1
        output = self._ends.get(output, output) or f"added_{self._count}"
        self._front.append(helper.make_node(operator, names, [output], **attributes))
        return output

    def _constant(self, value: np.ndarray) -> str:
        self._count += 1
        self.model.graph.initializer.append(numpy_helper.from_array(value, f"added_{self._count}"))
        return f"added_{self._count}"

    def column(self, number: int, of: str = "obs_given") -> str:
        """Shape (B, 1)."""
        return self("Gather", of, np.array([number]), axis=1)

    def hashed(self, seed: int) -> str:
        """A number that small differences of the observation turn into any other, shape (B, 1)."""
        weights = np.random.default_rng(seed).normal(0.0, 1000.0, self.observed).astype(np.float32)
        return self("ReduceSum", self("Mul", "obs_given", weights), np.array([1]), keepdims=1)

    def untouched(self) -> "_Addition":
        """Lets the observation through."""
        self("Identity", "obs_given", output="obs_seen")
        return self

    def save(self, output: Path) -> Path:
        """The model with its nodes in an order in which they can be computed."""
        waiting, known = [*self._front, *self._inner], {self._ends["obs_given"], ""}
        known |= {tensor.name for tensor in self.model.graph.initializer}
        del self.model.graph.node[:]
        while waiting:
            ready = [node for node in waiting if known.issuperset(node.input)]
            assert ready
            self.model.graph.node.extend(ready)
            known.update(name for node in ready for name in node.output)
            waiting = [node for node in waiting if node not in ready]
        output.parent.mkdir(parents=True, exist_ok=True)
        if self._contract is not None:
            params = output.parents[1] / "params"
            params.mkdir(exist_ok=True)
            shutil.copy(self._contract, params)
        return _save(self.model, output)


def _behind_output(model, node) -> None:
    """Put an operator between what computes the action and the model's output."""
    name = model.graph.output[0].name
    for other in model.graph.node:
        for i, output in enumerate(other.output):
            if output == name:
                other.output[i] = "before_the_change"
    model.graph.node.append(node("before_the_change", name))


def _load(path: Path):
    model = onnx.load(str(path))
    kept = [entry for entry in model.metadata_props if entry.key != GOLDEN_KEY]
    copies = [type(entry).FromString(entry.SerializeToString()) for entry in kept]
    del model.metadata_props[:]
    model.metadata_props.extend(copies)
    return model


def _save(model, output: Path) -> Path:
    onnx.save(model, str(output))
    return output
