"""Whether what was measured of a logger is what the logger did: the tolerances of reports/loggers.md."""

import math
from typing import Any

from hidden import CHANNELS
from hidden.sensors import COLUMNS

from observer_fi.records import Acquisition, ChannelTraits, Clock

NOISE, RESOLUTION, LINE_HZ, LINE_AMPLITUDE = 0.10, 0.05, 0.2, 0.15  # relative but for Hz
JITTER = 0.15  # relative
REST_S = (
    0.3  # of a move's log, in which the noise is measured: it cannot be known better than from these readings
)
PLAIN_STEP = 0.5  # of the noise: finer steps may go untold
FAINT_LINE = 0.5  # of the noise: fainter lines may
COLOUR_S = 0.6e-3  # shorter correlation is within a sample


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
        "update rate": sizes["update_hz"] == traits.update_hz,
        "lines": _lines_right(sizes, traits),
        "colour": (traits.correlation_s is not None) == ((sizes["correlation_s"] or 0.0) > COLOUR_S),
    }
    return [name for name, as_it_was in right.items() if not as_it_was]


def _noise_right(sizes: dict[str, Any], traits: ChannelTraits, fresh_hz: float) -> bool:
    """Where all noise is coloured, its whole size counts."""
    true = sizes["noise_std"] or sizes["wander_std"]
    chance = 3.0 / math.sqrt(2.0 * REST_S * fresh_hz)
    return abs(traits.noise_std / true - 1.0) <= NOISE + chance


def _resolution_right(sizes: dict[str, Any], traits: ChannelTraits) -> bool:
    true, noise = sizes["resolution"], sizes["noise_std"] or sizes["wander_std"]
    if traits.resolution is None:
        return true is None or true < PLAIN_STEP * noise
    return true is not None and abs(traits.resolution / true - 1.0) <= RESOLUTION


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
    coarse = told["resolution_s"]
    stepped = clock.resolution_s is None if coarse is None else clock.resolution_s == coarse
    jitter = told["jitter_s"]
    # stamps in steps differ from a regular clock's by up to half a step
    moved = coarse is not None or abs(clock.jitter_s - jitter) <= JITTER * max(jitter, 1e-6)
    return [name for name, right in (("clock resolution", stepped), ("jitter", moved)) if not right]
