"""The fit: which parameters the data can decide, their values by `mujoco.sysid`, and intervals that do not flatter."""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np
from mujoco import minimize
from scipy.stats import t as student

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.sysid.data import SETTLING, Window
from humanoid_sim.sysid.model import KINDS, LONGEST_DELAY, FitModel, Prediction, islands

Sharing = Literal["joint", "model"]
"""Owners of parameters: each joint, or all joints with the same model of motor in common."""

_COARSE = 0.002
"""s, physics step of the derivatives: they need not be as exact as the predictions."""
_STEP = 1e-3
"""Step of the derivatives, in a parameter's own unit."""
_FIRST_SECONDS = 16.0
"""s of data that the first approximation is made from."""
_DAMPING = {"mu_min": 1e2, "mu_factor": 10.0, "mu_max": 1e10}
"""Damping of the optimiser's steps: the squared derivatives are 1e4 to 1e8, and each value costs a simulation."""
_BLOCK = 2.0
"""s of neighbouring residuals that are taken to be one observation: their errors go together."""
_CONFIDENCE = 0.95
_UNDECIDED = 0.5
"""Half-width of an interval, in a parameter's own unit, from which the data are said not to decide it."""
_ASSUMED = 5e-4, 0.01
"""rad and rad/s, standard deviations of what is reported, before a fit has shown them."""
_LEAST = 2e-5, 5e-4
"""Likewise, the least that a fit is believed."""
_CAUTION = 2.0
"""Factor on intervals that are expected before a fit, whose residuals will not be independent."""


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """One number that is fitted: of one joint, or of all that share it."""

    name: str
    """Joint or motor model, and kind: `left_elbow_pitch armature`."""
    kind: str
    places: tuple[tuple[int, int], ...]
    """Row of `KINDS` and the robot's joint, of each value that it is."""
    old: float
    unit: float
    """A typical size."""
    lower: float
    upper: float
    start: float


@dataclass(slots=True)
class Fitted:
    """A parameter with what the data say of it; `value` is the old one where they say nothing."""

    parameter: FreeParameter
    value: float
    half_width: float
    """Half the interval, 95 %; of an undecided one what it would have been."""
    reason: str = ""
    """Reason why it is undecided; empty: it is fitted."""

    @property
    def is_decided(self) -> bool:
        """Return whether it was fitted."""
        return not self.reason


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Everything that is fitted."""

    parameters: tuple[Fitted, ...]
    old: FloatArray
    """Shape (6, n), the order of `KINDS`."""
    new: FloatArray
    """Likewise."""
    models: tuple[FitModel, ...] = field(repr=False)

    def predict(self, window: Window, values: FloatArray) -> Prediction:
        """Predict the reports of all joints in a window with parameters (6, n)."""
        shape = (window.last - window.first, values.shape[1])
        whole = Prediction(np.empty(shape), np.empty(shape), np.empty(shape))
        for model in self.models:
            columns = list(model.joints)
            own = values[:, columns]
            part = model.rollout([model.with_parameters(own)], [own], window)[0]
            for name in ("position", "velocity", "effort"):
                getattr(whole, name)[:, columns] = getattr(part, name)
        return whole


def parameters_of(
    description: RobotDescription, old: FloatArray, kinds: Sequence[str] = KINDS, sharing: Sharing = "joint"
) -> list[FreeParameter]:
    """Return what can be fitted of a robot whose present parameters are `old`, (6, n)."""
    found: dict[tuple[str, str], FreeParameter] = {}
    for j, joint in enumerate(description.joints):
        limit = min(joint.effort_limit, 30.0)
        model = None if joint.motor is None else joint.motor.model
        for row, kind in enumerate(KINDS):
            if kind not in kinds:
                continue
            owner = joint.name if sharing == "joint" or kind == "offset" or model is None else model
            value = float(old[row, j])
            unit, lower, upper = {
                "armature": (max(value, 1e-3), 0.05 * value, 20.0 * max(value, 1e-3)),
                "friction": (max(value, 0.01 * limit), 0.0, 0.5 * limit),
                "damping": (max(value, 0.01 * limit), 0.0, 0.3 * limit),
                "torque_scale": (0.5, 0.3, 2.0),
                "offset": (0.02, -0.4, 0.4),
                "delay": (0.004, 0.0, LONGEST_DELAY),
            }[kind]
            known = found.get((owner, kind))
            places = ((row, j),) if known is None else (*known.places, (row, j))
            start = max(value, 0.3 * unit) if kind in ("friction", "damping", "delay") else value
            found[owner, kind] = FreeParameter(f"{owner} {kind}", kind, places, value, unit, lower, upper, start)
    return list(found.values())


class Problem:
    """Residuals of some parameters on windows of data, for `mujoco.sysid`; the parameters in their own units."""

    def __init__(
        self,
        models: tuple[FitModel, FitModel],
        windows: Sequence[Window],
        parameters: Sequence[FreeParameter],
        values: FloatArray,
        noise: FloatArray,
    ) -> None:
        """Set the problem.

        Args:
            models: with the robot's own physics step, and with a coarse one for derivatives.
            values: shape (6, n of the robot), of everything that is not among the parameters.
            noise: shape (2, n of the model), rad and rad/s, of positions and velocities.
        """
        self._sysid = _library()
        self._models, self._windows, self.parameters = models, list(windows), list(parameters)
        self._values, self._noise = values, noise
        series = self._sysid.TimeSeries
        times = [window.run.time[window.first : window.last] for window in windows]
        measured = [self._measured(window) for window in windows]
        model = models[0]
        controls = [model.control(window)[-len(time) :] for window, time in zip(windows, times, strict=True)]
        signals = [series(time, control) for time, control in zip(times, controls, strict=True)]
        self._window_of = {id(signal): window for signal, window in zip(signals, windows, strict=True)}
        self._residuals = [
            self._sysid.build_residual_fn(
                models_sequences=[
                    self._sysid.ModelSequences(
                        "robot",
                        own.spec,
                        [f"window {i}" for i in range(len(windows))],
                        [own.start_state(window) for window in windows],
                        signals,
                        [series(time, data) for time, data in zip(times, measured, strict=True)],
                    )
                ],
                build_model=lambda params, _, own=own: own.with_parameters(self._own(params)),
                custom_rollout=self._rollout(own),
                modify_residual=self._difference,
                resample_true=False,
                n_threads=1,
            )
            for own in models
        ]
        self._blocks = np.concatenate(
            [
                np.repeat(((time - time[0]) // _BLOCK + 1000 * i)[self._settled(window)], 2 * len(model.joints))
                for i, (time, window) in enumerate(zip(times, windows, strict=True))
            ]
        )

    def solve(self, start: FloatArray, iterations: int) -> FloatArray:
        """Return the best values of the parameters, shape (p,), from `start` on."""
        parameters = self._parameters(start)
        best, _ = self._sysid.optimize(
            parameters,
            self._residuals[0],
            verbose=False,
            max_iters=iterations,
            jacobian=lambda x, _: self.jacobian(x[:, 0]),
            output=io.StringIO(),
            xtol=1e-4,
            **_DAMPING,
        )
        found: FloatArray = best.as_vector() * self._units
        return found

    def residuals(self, values: FloatArray, model: int = 0) -> FloatArray:
        """Shape (r,): what the predictions with parameters (p,) differ from the reports, over the noise."""
        scaled = values / self._units
        return np.concatenate(self._residuals[model](scaled, self._parameters(values))[0])

    def jacobian(self, scaled: FloatArray) -> FloatArray:
        """Shape (r, p), of parameters in their own units."""
        parameters = self._parameters(scaled * self._units)

        def coarse(x: FloatArray) -> FloatArray:
            return np.concatenate(self._residuals[1](x, parameters)[0])

        bounds = [bound[:, None] for bound in parameters.get_bounds()]
        middle = coarse(scaled[:, None])
        found: FloatArray = minimize.jacobian_fd(coarse, scaled[:, None], middle, np.float64(_STEP), 0, bounds)[0]
        return found

    def half_widths(self, values: FloatArray) -> FloatArray:
        """Shape (p,), of the intervals of fitted values: blocks of neighbouring residuals count as one observation."""
        jacobian, residual = self.jacobian(values / self._units), self.residuals(values)
        names, index = np.unique(self._blocks, return_inverse=True)
        scores = np.zeros((len(names), len(values)))
        np.add.at(scores, index, jacobian * residual[:, None])
        influence = np.linalg.lstsq(jacobian.T @ jacobian, scores.T, rcond=1e-12)[0]
        count = len(names)
        spread = np.sqrt((influence**2).sum(axis=1) * count / max(count - 1, 1))
        quantile = float(student.ppf(0.5 + 0.5 * _CONFIDENCE, max(count - 1, 1)))
        widths: FloatArray = spread * quantile * self._units
        return widths

    def undecided(self, values: FloatArray) -> dict[int, tuple[float, str]]:
        """Return which parameters the data would not decide, with the expected half-width and the reason."""
        hessian = _hessian(self.jacobian(values / self._units))
        left, found = list(range(len(values))), {}
        while left:
            widths = _CAUTION * 1.96 * _spread(hessian[np.ix_(left, left)])
            worst = int(widths.argmax())
            if widths[worst] <= _UNDECIDED:
                break
            alone = 1.0 / np.sqrt(max(hessian[left[worst], left[worst]], 1e-30))
            own = float(_CAUTION * 1.96 * alone)
            reason = "hardly moved" if own > _UNDECIDED else self._rival(hessian, left, worst)
            i = left.pop(worst)
            found[i] = float(widths[worst] * self._units[i]), reason
        return found

    def noise_of(self, values: FloatArray) -> FloatArray:
        """Shape (2, n): what a fit leaves of positions, rad, and velocities, rad/s."""
        residual = self.residuals(values).reshape(-1, 2, self._noise.shape[1])
        left: FloatArray = np.maximum(np.sqrt((residual**2).mean(axis=0)) * self._noise, np.array(_LEAST)[:, None])
        return left

    @property
    def _units(self) -> FloatArray:
        return np.array([parameter.unit for parameter in self.parameters])

    def _rival(self, hessian: FloatArray, left: list[int], worst: int) -> str:
        covariance = np.linalg.pinv(hessian[np.ix_(left, left)], hermitian=True)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        alike = np.abs(covariance[worst] / (size * size[worst]))
        alike[worst] = 0.0
        return f"cannot be told from {self.parameters[left[int(alike.argmax())]].name}"

    def _parameters(self, values: FloatArray) -> Any:
        made = self._sysid.ParameterDict()
        for parameter, value in zip(self.parameters, values, strict=True):
            unit = parameter.unit
            made.add(
                self._sysid.Parameter(parameter.name, value / unit, parameter.lower / unit, parameter.upper / unit)
            )
        return made

    def _own(self, params: Any) -> FloatArray:
        """Shape (6, n of the model): all values, the parameters' own among them."""
        values = self._values.copy()
        for parameter, value in zip(self.parameters, params.as_vector(), strict=True):
            for row, joint in parameter.places:
                values[row, joint] = value * parameter.unit
        own: FloatArray = values[:, list(self._models[0].joints)]
        return own

    def _rollout(self, own: FitModel) -> Callable[..., list[Any]]:
        def custom_rollout(
            *, models: Sequence[mujoco.MjModel], control_signal: Sequence[Any], param_dicts: Sequence[Any], **_: Any
        ) -> list[Any]:
            window = self._window_of[id(control_signal[0])]
            time = window.run.time[window.first : window.last]
            values = [self._own(params) for params in param_dicts]
            found = own.rollout(models, values, window)
            series, trajectory = self._sysid.TimeSeries, self._sysid.SystemTrajectory
            return [
                trajectory(
                    model=model,
                    control=control_signal[0],
                    sensordata=series(time, np.concatenate([one.position, one.velocity, one.effort], axis=1)),
                    initial_state=np.zeros(0),
                    state=series(time, time[:, None]),
                )
                for model, one in zip(models, found, strict=True)
            ]

        return custom_rollout

    def _difference(self, _: Any, predicted: Any, measured: Any, *__: Any, **___: Any) -> tuple[FloatArray, Any, Any]:
        n = self._noise.shape[1]
        kept = measured.times - measured.times[0] >= SETTLING
        residual = (predicted.data[kept, : 2 * n] - measured.data[kept, : 2 * n]) / self._noise.reshape(-1)
        return residual.ravel(), predicted, measured

    def _measured(self, window: Window) -> FloatArray:
        run, rows, columns = window.run, slice(window.first, window.last), list(self._models[0].joints)
        return np.concatenate([array[rows][:, columns] for array in (run.position, run.velocity, run.effort)], axis=1)

    @staticmethod
    def _settled(window: Window) -> FloatArray:
        time = window.run.time[window.first : window.last]
        settled: FloatArray = time - time[0] >= SETTLING
        return settled


def _hessian(jacobian: FloatArray) -> FloatArray:
    hessian: FloatArray = jacobian.T @ jacobian
    return hessian


def _spread(hessian: FloatArray) -> FloatArray:
    """Shape (p,), standard deviations; very large where the data say nothing."""
    spread: FloatArray = np.sqrt(np.diag(np.linalg.inv(hessian + 1e-9 * np.eye(len(hessian)))))
    return spread


def _library() -> Any:
    """Return `mujoco.sysid`. Raises `MissingPackageError` without its packages."""
    # by its name: types that it has and MuJoCo has not would hide MuJoCo from mypy
    sysid = importlib.import_module("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        raise MissingPackageError("mujoco.sysid", "sysid", "sysid")
    logging = importlib.import_module("absl.logging")
    logging.set_verbosity(logging.ERROR)  # it warns of parameters whose bounds are far away
    return sysid


def fit(
    description: RobotDescription,
    windows: Sequence[Window],
    *,
    kinds: Sequence[str] = KINDS,
    sharing: Sharing = "joint",
    say: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit a robot to measured windows.

    Args:
        kinds: of parameters, of `KINDS`.
        sharing: see `Sharing`.
        say: is told a line about each step.

    Raises:
        InputError: there are no windows.
        MissingPackageError: the packages of `mujoco.sysid` are not installed.
    """
    if not windows:
        raise InputError("recordings: hold no stretch of 2 s in which every joint is heard and held by a stiffness")
    groups = islands(description) if sharing == "joint" else [tuple(range(description.joint_count))]
    pairs = [_models(description, joints) for joints in groups]
    old = np.empty((len(KINDS), description.joint_count))
    for fine, _ in pairs:
        old[:, list(fine.joints)] = fine.nominal()
    new, found = old.copy(), []
    for pair in pairs:
        own = [p for p in parameters_of(description, old, kinds, sharing) if p.places[0][1] in pair[0].joints]
        found += _fit_group(pair, windows, own, new, say)
    for item in found:
        for row, joint in item.parameter.places:
            new[row, joint] = item.value
    return Fit(tuple(found), old, new, tuple(fine for fine, _ in pairs))


def _models(description: RobotDescription, joints: tuple[int, ...]) -> tuple[FitModel, FitModel]:
    own = description.simulation.physics_timestep
    return FitModel(description, joints), FitModel(description, joints, max(own, _COARSE))


def _fit_group(
    models: tuple[FitModel, FitModel],
    windows: Sequence[Window],
    parameters: list[FreeParameter],
    values: FloatArray,
    say: Callable[[str], None],
) -> list[Fitted]:
    noise = np.repeat(np.array(_ASSUMED)[:, None], len(models[0].joints), axis=1)
    few = _few(windows)
    best = np.array([parameter.start for parameter in parameters])
    joints = ", ".join(dict.fromkeys(parameter.name.split()[0] for parameter in parameters))
    left_out = Problem(models, few, parameters, values, noise).undecided(best)
    found: dict[str, Fitted] = {}

    def leave_out(chosen: dict[int, tuple[float, str]]) -> None:
        nonlocal parameters, best
        for i, (width, reason) in chosen.items():
            found[parameters[i].name] = Fitted(parameters[i], parameters[i].old, width, reason)
        kept = [i for i in range(len(parameters)) if i not in chosen]
        parameters, best = [parameters[i] for i in kept], best[kept]

    all_parameters = parameters
    leave_out(left_out)
    if not parameters:
        return [found[parameter.name] for parameter in all_parameters]
    say(f"{joints}: {len(parameters)} of {len(all_parameters)} parameters can be decided")
    problem = Problem(models, few, parameters, values, noise)
    best = problem.solve(best, 40)
    noise = problem.noise_of(best)
    while parameters:
        problem = Problem(models, windows, parameters, values, noise)
        best = problem.solve(best, 20)
        widths = problem.half_widths(best)
        units = np.array([parameter.unit for parameter in parameters])
        wide = {
            i: (float(widths[i]), "its interval is too wide")
            for i in np.flatnonzero(widths > _UNDECIDED * units).tolist()
        }
        if not wide:
            break
        leave_out(wide)
    for parameter, value, width in zip(parameters, best, widths if parameters else (), strict=True):
        # a command takes effect with a physics step, which no data resolve further
        resolution = models[0].timestep if parameter.kind == "delay" else 0.0
        found[parameter.name] = Fitted(parameter, float(value), float(np.hypot(width, resolution)))
    return [found[parameter.name] for parameter in all_parameters]


def _few(windows: Sequence[Window]) -> list[Window]:
    """Return windows from all over the data, of together not much more than the first approximation needs."""
    total = sum(window.duration for window in windows)
    step = max(int(total / _FIRST_SECONDS), 1)
    return list(windows[::step])
