"""The report of a diagnosis as dataclasses, field by field as in report.json (docs: Reference, Report of the diagnosis)."""

from __future__ import annotations

import dataclasses
import json
import os
import types
import typing
from dataclasses import dataclass
from typing import Any, TypeVar

from . import _core
from ._arrays import file_name

_T = TypeVar("_T")


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval."""

    value: float | None
    ci: tuple[float | None, float | None]
    """Lower and upper end."""


@dataclass(frozen=True)
class Parameter(Estimate):
    """A fitted parameter of a cause."""

    word: str
    """Name without its unit."""
    unit: str
    text: str
    """In words, with interval."""


@dataclass(frozen=True)
class Cut:
    """A place in the chain from command to tip where signals are compared."""

    cut: str
    """C0 to C6."""
    title: str
    _from: str
    to: str


@dataclass(frozen=True)
class CutFinding:
    """The residual (measured less simulated) behind one cut, of one tendon's tension or one section's tip."""

    cut: str
    where: str
    quantity: str
    unit: str
    measured: bool
    """False: cannot be determined from these logs, `note` says why."""
    rms: float | None
    floor: float | None
    """RMS that noise and repeatability explain."""
    excess_sigma: float | None
    delta: float | None
    """Materiality in `unit`."""
    p_value: float | None
    excess: bool
    """Significant and larger than delta."""
    first: bool
    """The first excess in the chain: the gap lies here."""
    note: str
    tendon: int | None = None
    section: int | None = None


@dataclass(frozen=True)
class Cause:
    """One hypothesis with its probability."""

    effect: str
    """Registry name, 'no_gap' or 'unknown'."""
    where: str
    """'all', 'tendon:2', ...; empty for no_gap and unknown."""
    p: float
    """Probability."""
    group: int
    """Causes with the same number > 0 cannot be told apart by these runs."""
    parameters: dict[str, Parameter]
    bound_hit: bool
    """A fitted parameter lies at its bound."""
    held_out_gain: float | None
    """Share of the excess mean square on held-out families that it removes."""
    screening_gain: float | None
    note: str
    about: str
    """What the effect is."""


@dataclass(frozen=True)
class FamilyClosure:
    """Closure of the tip's position error for one kind of motion."""

    family: str
    runs: int
    before_m: float | None
    after_m: float | None
    floor_m: float | None
    closed: Estimate | None


@dataclass(frozen=True)
class ChannelClosure:
    """How far the gap shrinks in one channel on held-out runs with the accepted causes in the model."""

    value: float | None
    """Closed share; None: no significant gap here."""
    ci: tuple[float | None, float | None] | None
    before: float | None
    after: float | None
    ceiling: float | None
    floor: float | None
    unit: str
    cut: str
    channel: str
    as_filed: float | None = None
    """`before` with the numbers of the robot file, where it has those learned from earlier runs."""


@dataclass(frozen=True)
class Closed:
    """How far the gap shrinks on held-out runs."""

    pooled: Estimate | None
    """Over the channels with a significant gap."""
    ceiling: Estimate | None
    """When all parameters are refitted at once, an upper bound."""
    families: list[FamilyClosure]
    channels: dict[str, ChannelClosure]


@dataclass(frozen=True)
class NamedValue:
    """A number with a name."""

    name: str
    value: float | None


@dataclass(frozen=True)
class LearnedNumber:
    """A number of the robot file, fitted to the runs with all others within their priors."""

    key: str
    in_file: float | None
    value: float | None
    moved: float | None
    """From the file, in standard deviations of its prior."""


@dataclass(frozen=True)
class SuspectNumber:
    """A number of the robot file that, at another value, explains the runs better than any cause in the library."""

    key: str
    in_file: float | None
    value: float | None
    closed: Estimate | None


@dataclass(frozen=True)
class Confusion:
    """Two causes that look alike in these runs."""

    a: str
    b: str
    cosine: float | None
    """Of their sensitivities; 1: identical signatures."""
    profile_gap: float | None
    confirmed: bool


@dataclass(frozen=True)
class Baseline:
    """What a simpler method would name first from the same search."""

    name: str
    effect: str
    where: str


@dataclass(frozen=True)
class ConditionMap:
    """Mean of a residual as a function of a condition, with a band."""

    cut: str
    channel: str
    unit: str
    condition: str
    condition_unit: str
    at: list[float | None]
    mean: list[float | None]
    low: list[float | None]
    high: list[float | None]
    after: list[float | None]


@dataclass(frozen=True)
class Overlay:
    """Measured and simulated signal of a held-out run, without and with the causes."""

    run: str
    channel: str
    unit: str
    cut: str
    floor: float | None
    time_s: list[float | None]
    measured: list[float | None]
    before: list[float | None]
    after: list[float | None]
    against: str
    against_unit: str
    x: list[float | None]


@dataclass(frozen=True)
class FreeRun:
    """A free run of the simulator: plants that see nothing of a run but the torques that were sent."""

    run: str
    family: str
    duration_s: float | None
    moves_m: float | None
    """rms of the measured tip about its mean."""
    before_m: float | None
    """rms error of the nominal robot's tip."""
    after_m: float | None
    """With the causes; None: there are none."""


@dataclass(frozen=True)
class HorizonPoint:
    """Growth of the residual with the time since the simulation was reset to the measured state."""

    horizon_s: float | None
    rms_m: float | None
    floor_m: float | None


@dataclass(frozen=True)
class Profile:
    """How well a parameter is determined: the log score lost as a function of its value."""

    effect: str
    where: str
    parameter: str
    value: list[float | None]
    score: list[float | None]
    word: str
    unit: str


@dataclass(frozen=True)
class NextExperiment:
    """The experiment that would separate the rivals best."""

    family: str
    """Name of the `tendril excite` family; empty: none needed, or none helps."""
    reason: str
    separation_sigma: float | None
    yaml: str
    """Plan file for `tendril excite --plan` and `tendril.simulate(plan=...)`."""
    alternatives: list[NamedValue]


@dataclass(frozen=True)
class HealthFinding:
    """A problem found in the logs."""

    severity: str
    """'info', 'warning' or 'error'."""
    run: str
    channel: str
    value: float | None
    text: str


@dataclass(frozen=True)
class Repeatability:
    """Repetitions that differ by more than the sensors and the usual scatter of friction explain."""

    cut: str
    where: str
    quantity: str
    unit: str
    rms: float | None
    floor: float | None
    sigma: float | None
    depends_on: str
    p_value: float | None
    law: bool


@dataclass(frozen=True)
class RunSummary:
    """A run that was used."""

    name: str
    family: str
    repeat_of: str
    sha256: str
    duration_s: float | None
    rate_Hz: float | None
    samples: int
    before: str
    before_sha256: str


@dataclass(frozen=True)
class Provenance:
    """What the report was made from."""

    robot_name: str
    robot_yaml: str
    runs: list[RunSummary]
    held_out_families: list[str]
    held_out_by: str
    delta_N: float | None
    delta_m: float | None
    seed: int
    version: str
    revision: str
    command: str
    seconds: float | None
    """Duration of the diagnosis, the only number that differs between identical runs."""


@dataclass(frozen=True, repr=False)
class Report:
    """The outcome of a diagnosis. `print(report)`, or `report` at the end of a notebook's cell, shows the summary that
    the command line prints."""

    format: int
    verdict: str
    """'no_gap', 'attributed', 'ambiguous_group', 'unexplained' or 'insufficient_data'."""
    sentence: str
    """Where, what, how certain, how far the gap shrinks, what to do next."""
    location: list[CutFinding]
    """In chain order."""
    causes: list[Cause]
    """By falling p, with no_gap and unknown."""
    accepted: list[Cause]
    """The causes that the model needs: none, one, or the members of a pair."""
    order_effects: list[NamedValue]
    leftover_sigma: float | None
    """What the best model leaves beyond the floor on held-out data."""
    learned: list[LearnedNumber]
    """By falling distance from the file; empty: it explains the runs as it is."""
    suspected: list[SuspectNumber]
    doubt: str
    """Why the likeliest cause is not established; empty where it is, or there is none."""
    confusable: list[Confusion]
    baselines: list[Baseline]
    condition_maps: list[ConditionMap]
    overlays: list[Overlay]
    horizon: list[HorizonPoint]
    profiles: list[Profile]
    input_correlations: list[NamedValue]
    next_experiment: NextExperiment
    data_health: list[HealthFinding]
    degradations: list[str]
    """What these logs lack, and what therefore cannot be determined."""
    next_commands: list[str]
    """To run now, each a complete `tendril ...` line; of a report made by the command line."""
    free_runs: list[FreeRun]
    """By kind of motion."""
    closed: Closed
    repeatability: Repeatability | None
    chain: list[Cut]
    shown_units: dict[str, list[tuple[float | None, float, str]]]
    provenance: Provenance
    _diagnosis: _core.Diagnosis = dataclasses.field(compare=False)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Report:
        """Reads a report.json."""
        return Report._of(_core.read_report(file_name("path", path)))

    @staticmethod
    def _of(diagnosis: _core.Diagnosis) -> Report:
        values = json.loads(diagnosis.json())
        return _made(Report, values, "report", _diagnosis=diagnosis)

    def to_json(self) -> str:
        """The text of report.json."""
        return self._diagnosis.json()

    def to_html(self) -> str:
        """The report as one page that needs no network."""
        return self._diagnosis.page()

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes report.json and report.html into the folder, creating it."""
        self._diagnosis.write(file_name("folder", folder))

    def corrected(self, robot: _core.Robot) -> _core.Robot:
        """The robot with the numbers learned and the accepted causes: numbers of its file changed, laws in its `effects`."""
        return self._diagnosis.corrected(robot)

    def __str__(self) -> str:
        return self._diagnosis.summary()

    def __repr__(self) -> str:
        return f"<Report {self.verdict!r} of robot {self.provenance.robot_name!r}: {self.sentence}>"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """What IPython and Jupyter show of it."""
        printer.text(str(self))


def _made(kind: type[_T], values: dict[str, Any], at: str, **more: Any) -> _T:
    """The dataclass from its JSON object; a key that it has not is an error, so that the two cannot drift apart."""
    hints = typing.get_type_hints(kind)
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    named = {("_from" if key == "from" else key): value for key, value in values.items()}
    if unknown := named.keys() - fields.keys():
        raise ValueError(f"{at} has keys that this version does not know: {', '.join(sorted(unknown))}")
    return kind(**{key: _value(hints[key], value, f"{at}.{key}") for key, value in named.items()}, **more)


def _value(kind: Any, value: Any, at: str) -> Any:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if value is None:
        return None
    if origin in (types.UnionType, typing.Union):
        return _value(next(t for t in inner if t is not type(None)), value, at)
    if origin is list:
        return [_value(inner[0], item, f"{at}[{i}]") for i, item in enumerate(value)]
    if origin is dict:
        return {key: _value(inner[1], item, f"{at}.{key}") for key, item in value.items()}
    if origin is tuple:
        return tuple(value)
    return _made(kind, value, at) if dataclasses.is_dataclass(kind) else value  # type: ignore[arg-type]
