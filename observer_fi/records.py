"""The named results a log passes through, in order. Plain data: no record computes anything.

Arrays are float64, SI units, on the log's own clock; n is the number of samples.
"""

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHANNELS = ("voltage", "current", "position")
SAMPLES = (
    "t",
    "z",
    "w_cmd",
    "pitch",
    "encoder",
    "force",
    "position_cmd",
    "load",
)  # fields of a Log with a value a sample


class Gap(NamedTuple):
    """Samples missing from the log's clock, between two times [s]."""

    start_s: float
    end_s: float
    samples: int


class Rejected(NamedTuple):
    """One repaired or masked sample: row in the file (1 is the first data row), column, and what was done and why."""

    row: int
    column: str
    reason: str


@dataclass(frozen=True)
class Log:
    """Measured channels on one clock; NaN marks a sample that is missing or was rejected.

    t (n,) s; z (n, 3) voltage [V], current [A], position [m]; w_cmd (n,) rad/s at the sample instant; pitch (n,) deg;
    encoder (n,) rad, force (n,) N, position_cmd (n,) m, load (n,) N, each or None. A long log comes as several of these,
    in order; `first_row` is the number of samples before this one.
    """

    path: str
    t: Array
    z: Array
    w_cmd: Array
    pitch: Array
    encoder: Array | None = None
    force: Array | None = None
    position_cmd: Array | None = None
    load: Array | None = None
    sha256: str = ""
    metadata: tuple[str, ...] = ()
    gaps: tuple[Gap, ...] = ()
    rejected: tuple[Rejected, ...] = ()
    rejected_count: int = 0
    notes: tuple[str, ...] = ()
    first_row: int = 0

    @cached_property
    def rate_hz(self) -> float:
        """Median sampling rate [Hz]. Kept: a long log is asked for it at every move."""
        return float(1.0 / np.median(np.diff(self.t))) if self.t.size > 1 else float("nan")

    def part(self, rows: slice | NDArray[np.intp]) -> "Log":
        """These samples of every channel; what is said of the whole log stays."""
        given = ((name, getattr(self, name)) for name in SAMPLES)
        cut: dict[str, Any] = {name: None if every is None else every[rows] for name, every in given}
        return replace(self, **cut)


class Segment(NamedTuple):
    """One move and the rests around it, as sample indices.

    [rest, start) is at rest before the move, [start, stop) has a commanded speed, [stop, end) is the stop and the rest
    after it. peak [rad/s] is the commanded speed of largest magnitude, signed; pitch [deg] the mean pitch.
    """

    rest: int
    start: int
    stop: int
    end: int
    peak: float
    pitch: float


class Line(NamedTuple):
    """A periodic disturbance of a channel, mains hum for one: its frequency [Hz] and amplitude in the channel's unit."""

    hz: float
    amplitude: float


IN_A_BAND = 0.3  # share of such readings


class ChannelTraits(NamedTuple):
    """What a logger does to one channel, in its unit. NaN noise where there is no such channel.

    noise_std: without lines and rounding; as_white: standard deviation of the white noise that says as little about what is
    slow; resolution: the step of the readings, update_hz: how often a held one is fresh, correlation_s: of coloured noise,
    None where there is none; spikes: how many there are; averaged: samples of which a reading is the mean; offset: mean
    reading at rest; neighbour_std: standard deviation of the noise by which a reading differs from the one before;
    repeats: share of readings at rest that repeat the one before, though no hold is known; grown: by what the noise of
    the last rest is more than that of the first; travel: largest less smallest reading of the log; low_pass_hz: corner of a
    filter before the readings that was taken out of them, None where there is none; hold_s: how long a reading stands at
    most that is held unevenly [s], None of others; moving: by what its noise is more in motion than at rest;
    read: share of the rows that have a reading; share: of the reading, by which its noise grows with it; late_s: by which it is
    read later than the earliest channel, as the logs of a rig without a known servo have shown.
    """

    noise_std: float
    as_white: float
    resolution: float | None = None
    update_hz: float | None = None
    lines: tuple[Line, ...] = ()
    correlation_s: float | None = None
    spikes: int = 0
    averaged: int = 1
    offset: float = 0.0
    neighbour_std: float = math.nan
    repeats: float = 0.0
    grown: float = 1.0
    travel: float = math.inf
    low_pass_hz: float | None = None
    hold_s: float | None = None
    moving: float = 1.0
    read: float = 1.0
    share: float = 0.0
    late_s: float = 0.0

    @property
    def in_a_band(self) -> bool:
        """Whether many readings repeat the one before, without steps or a hold: a new one comes where it left a dead band."""
        return not self.resolution and not self.update_hz and self.repeats > IN_A_BAND


class Clock(NamedTuple):
    """Jitter of time stamps and their step [s], None where they are as fine as the jitter; the usual interval of samples [s]."""

    jitter_s: float
    resolution_s: float | None
    interval_s: float


class Acquisition(NamedTuple):
    """What a logger does to its channels, and its clock."""

    voltage: ChannelTraits
    current: ChannelTraits
    position: ChannelTraits
    clock: Clock


@dataclass(frozen=True)
class Estimate:
    """What a bank or the mixture says at every sample, causally.

    modes: names of the m hypotheses. probability (n, m): rows sum to one. nis (n, m) normalised innovation squared of
    every hypothesis, NaN where nothing was measured; predicted (n, m, 3) voltage, current, position before the update;
    winner (n,) index of the most probable hypothesis; normalised (n, 3) innovations of the winner over their standard
    deviations; states (n, 4) the mixed w, I, x and commanded current; active (n,) whether the sample counts as
    evidence (a move, not a rest); density (n, m) log-densities; strain (n, m) how far a hypothesis stretched constants
    that only it has, in prior standard deviations (both empty where the method has none).
    """

    t: Array
    modes: tuple[str, ...]
    probability: Array
    nis: Array
    predicted: Array
    normalised: Array
    states: Array
    active: NDArray[np.bool_]
    density: Array = field(default_factory=lambda: np.empty((0, 0)))
    strain: Array = field(default_factory=lambda: np.empty((0, 0)))

    def at(self, chosen: NDArray[np.bool_]) -> "Estimate":
        """The samples that `chosen` (n,) marks."""
        if chosen.all():
            return self
        arrays = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.name != "modes"}
        return replace(self, **arrays)


class Severity(NamedTuple):
    """How severe a fault is in one respect: name, value with its 95 % interval, unit, and the same in words."""

    name: str
    value: float
    interval: tuple[float, float]
    unit: str
    words: str


class Detectable(NamedTuple):
    """The smallest severity of one fault that a healthy move would have shown: label, what is told, value, unit, in words."""

    label: str
    name: str
    value: float
    unit: str
    words: str


class CouldShow(NamedTuple):
    """What a healthy move could have shown of faults that begin at a time in it [s]; blind: labels that it shows at no size."""

    begin_s: float
    least: tuple[Detectable, ...]
    blind: tuple[str, ...]


class Event(NamedTuple):
    """The verdict on one move: label, channel for a sensor fault, probability, and the times of contract section 3.

    start_s, end_s: of the move. over_s: when a fault that came for a while was over. severity: what the whole move says of the
    fault's own constants; alike: labels that it cannot tell from the verdict. doubted_s: when another hypothesis was first
    certain for a moment, whatever the verdict. then: a second fault of the same move, behind the first.
    """

    label: str
    channel: str | None
    probability: float
    onset_s: float | None
    onset_interval_s: tuple[float | None, float | None]
    detected_s: float | None
    isolated_s: float | None
    start_s: float
    end_s: float
    posterior: dict[str, float]
    reasons: tuple[str, ...] = ()
    over_s: float | None = None
    severity: tuple[Severity, ...] = ()
    alike: tuple[str, ...] = ()
    doubted_s: float | None = None
    then: tuple["Event", ...] = ()


class Consistency(NamedTuple):
    """How well the winning hypotheses explain the data: mean NIS, its expected value, and a whiteness p-value."""

    nis_mean: float
    nis_expected: float
    whiteness_p: float


@dataclass(frozen=True)
class Isolation:
    """One verdict for each move of a log, and one for the log. could_show: where that is an all-clear, what it is worth."""

    verdict: Event
    events: tuple[Event, ...]
    consistency: Consistency
    could_show: CouldShow | None = None


@dataclass(frozen=True)
class Parameter:
    """One estimated value: name, value, standard error, what it was before, unit, and a 95 % interval."""

    name: str
    value: float
    std: float
    prior: float
    unit: str
    low: float
    high: float


class Filter(NamedTuple):
    """A low-pass filter before the readings of a channel: corner [Hz], order, and samples by which they are later still."""

    channel: str
    corner_hz: float
    order: int
    late: float = 0.0


@dataclass(frozen=True)
class Fit:
    """A rig learned from logs: values, their correlation (k, k), what could not be identified and what to record.

    filters: that the logger has before its readings, as the logs show them. warnings: what the rig's equations leave out.
    inductance: of the winding [H], where logs show one.
    """

    parameters: tuple[Parameter, ...]
    correlation: Array
    not_identifiable: dict[str, str]
    nll_per_sample: float
    rmse: dict[str, float]
    figures: dict[str, Any] = field(default_factory=dict)
    filters: tuple[Filter, ...] = ()
    warnings: tuple[str, ...] = ()
    inductance: Parameter | None = None


@dataclass(frozen=True)
class Traces:
    """What is drawn: the whole log decimated with its extremes kept, or every sample around an onset (k points).

    t (k,); z (k, 3); w (k,) measured speed of equation 16; w_cmd, pitch (k,); probability (k, m); predicted (k, m, 3) and
    w_predicted (k, m) one step ahead; norm (k, m) the residual norm of equation 19; normalised (k, 3) innovations of the
    winner; mixture_t (q,), mixture_norm (q, 3) and mixture_predicted (q, 3, 3) of the open-loop mixture's nominal, overload
    and coupling loss from its start on (empty where it did not run). evidence (k, m): how much more or less likely each
    hypothesis made the samples since the onset of the fault, or since a healthy move began, than the best one of each
    sample did [nats], NaN where there is no move; spared (k, m, 3): minus half the squared residuals of voltage, current and
    position over their noise, summed likewise; posterior (k, 7): the
    probabilities of the contract's labels as the verdicts leave them, where tests of a whole move may overrule the bank.
    """

    t: Array
    z: Array
    w: Array
    w_cmd: Array
    pitch: Array
    probability: Array
    predicted: Array
    w_predicted: Array
    norm: Array
    normalised: Array
    mixture_t: Array
    mixture_norm: Array
    mixture_predicted: Array
    evidence: Array
    spared: Array
    posterior: Array


@dataclass(frozen=True)
class Outcome:
    """What one command has to say about one log: what `report.py` prints, or the reason why there is nothing.

    log: the log without its samples (t, z, w_cmd and pitch are empty; everything else is kept); samples, rate_hz and
    duration_s of the whole log; acquisition, warnings: what its logger does, and what that hides; modes: the m hypotheses in
    the order of the traces. overview: the whole log, decimated, with every sample near the moments that matter; zoom: those
    around the verdict's onset.
    """

    name: str
    log: Log | None
    samples: int = 0
    rate_hz: float = float("nan")
    duration_s: float = 0.0
    modes: tuple[str, ...] = ()
    isolation: Isolation | None = None
    open_loop: Isolation | None = None
    overview: Traces | None = None
    zoom: Traces | None = None
    explanation: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    error: str | None = None
    acquisition: Acquisition | None = None
    warnings: tuple[str, ...] = ()
