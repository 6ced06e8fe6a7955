"""Whether what was measured of a logger is what the logger did: the tolerances of reports/loggers.md."""

import math
from typing import Any

from hidden import CHANNELS
from hidden.sensors import COLUMNS

from observer_fi.records import Acquisition, ChannelTraits, Clock

NOISE, RESOLUTION, LINE_HZ, LINE_AMPLITUDE = 0.10, 0.05, 0.2, 0.15  # relative but for Hz
JITTER, AVERAGED, EXACT = 0.15, 0.10, 1e-4  # relative
REST_S = (
    0.3  # of a move's log, in which the noise is measured: it cannot be known better than from these readings
)
PLAIN_STEP = 0.5  # of the noise: finer steps may go untold
FAINT_LINE = 0.5  # of the noise: fainter lines may
COLOUR_S = 0.6e-3  # shorter correlation is within a sample, and may go untold
BLIND_STEP = 2.0  # of the noise: in coarser ones a rest may not show it


def found(told: dict[str, dict[str, Any]], acquisition: Acquisition) -> str:
    """What is missing or wrong in `acquisition`, joined by "; ", empty if nothing is. told: `true_sizes` of tests/hidden."""
    wrong = []
    for channel in CHANNELS:
        if COLUMNS[channel] in told:
            sizes, traits = told[COLUMNS[channel]], getattr(acquisition, channel)
            wrong += [f"{channel} {item}" for item in _missed(sizes, traits, told["clock"]["rate_hz"])]
    return "; ".join([*wrong, *_missed_of_clock(told["clock"], acquisition.clock)])


def _missed(sizes: dict[str, Any], traits: ChannelTraits, rate_hz: float) -> list[str]:
    """Of one channel: the names of what is not as it was."""
    right = {
        "noise": _noise_right(sizes, traits, sizes["update_hz"] or rate_hz),
        "resolution": _resolution_right(sizes, traits),
        "update rate": _alike(sizes["update_hz"], traits.update_hz, EXACT),
        "averaging": _alike((sizes["averaged_s"] or 1.0 / rate_hz) * rate_hz, traits.averaged, AVERAGED),
        "lines": _lines_right(sizes, traits),
        "colour": _colour_right(sizes["correlation_s"], traits.correlation_s),
    }
    return [name for name, as_it_was in right.items() if not as_it_was]


def _alike(true: float | None, said: float | None, within: float) -> bool:
    """Both are none, or the second is within a share of the first."""
    if true is None or said is None:
        return true is said
    return abs(said / true - 1.0) <= within


def _noise(sizes: dict[str, Any]) -> float:
    """Of one reading: the white and the coloured part together."""
    return math.hypot(sizes["noise_std"], sizes["wander_std"])


def _noise_right(sizes: dict[str, Any], traits: ChannelTraits, fresh_hz: float) -> bool:
    if (sizes["resolution"] or 0.0) > BLIND_STEP * _noise(sizes):
        return True
    correlation = sizes["correlation_s"] or 0.0
    independent = min(fresh_hz, 0.5 / correlation) if correlation else fresh_hz
    chance = 3.0 / math.sqrt(2.0 * REST_S * independent)
    return _alike(_noise(sizes), traits.noise_std, NOISE + chance)


def _resolution_right(sizes: dict[str, Any], traits: ChannelTraits) -> bool:
    if traits.resolution is None and sizes["resolution"] is not None:
        return sizes["resolution"] < PLAIN_STEP * _noise(sizes)
    return _alike(sizes["resolution"], traits.resolution, RESOLUTION)


def _colour_right(true: float | None, said: float | None) -> bool:
    return (true is not None) if said is not None else (true or 0.0) <= COLOUR_S


def _lines_right(sizes: dict[str, Any], traits: ChannelTraits) -> bool:
    """Every line that stands out is there with its size, and no other."""
    plain = [line for line in sizes["lines"] if line[1] > FAINT_LINE * sizes["noise_std"]]
    alike = [
        any(
            abs(line.hz - hz) <= LINE_HZ and abs(line.amplitude / size - 1.0) <= LINE_AMPLITUDE
            for line in traits.lines
        )
        for hz, size in plain
    ]
    known = [any(abs(line.hz - hz) <= LINE_HZ for hz, _ in sizes["lines"]) for line in traits.lines]
    return all(alike) and all(known)


def _missed_of_clock(told: dict[str, Any], clock: Clock) -> list[str]:
    coarse, jitter = told["resolution_s"], told["jitter_s"]
    stepped = _alike(coarse, clock.resolution_s, RESOLUTION)
    # stamps in steps differ from a regular clock's by up to half a step
    moved = coarse is not None or abs(clock.jitter_s - jitter) <= JITTER * max(jitter, 1e-6)
    return [name for name, right in (("clock resolution", stepped), ("jitter", moved)) if not right]
