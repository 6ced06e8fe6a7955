"""Loggers as they are: traits by name, each drawn by a seed within its range, and pairs and triples of them.

Sigma is the noise of the rig file: 10 mV, 0.3 mA, 10 um at 1600 Hz. Three lines for a move through a logger:

    spec = draw_move_case(7000, "overload")
    frame, truth = make_log_with("hum_50hz+steps_all", spec, 7000)
    truth["acquisition"]["current_a"]["lines"]
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial, reduce
from typing import NamedTuple
from zlib import crc32

import numpy as np
import pandas as pd

from .acquisition import SENSOR_BAND_HZ, Acquisition, Chain, Line, ideal
from .faults import CHANNELS
from .sensors import COLUMNS
from .truth import TruthSpec, make_log_through

SIGMA = {"voltage": 10e-3, "current": 0.3e-3, "position": 10e-6}  # V, A, m
SAMPLE_S = 1.0 / SENSOR_BAND_HZ
RANGES = {
    "voltage": 20.0,
    "current": 1.0,
    "position": 50e-3,
}  # V, A, m: of a converter with 12 bits, both ways
WRITTEN = {"voltage": 1e-3, "current": 1e-3, "position": 1e-5}  # V, A, m: digits of a thrifty CSV
DECIMATED_HZ = 800.0  # rows of a logger whose stamps are whole milliseconds, and must differ

Draw = Callable[[Acquisition, np.random.Generator], Acquisition]


class Trait(NamedTuple):
    """What a logger does, in words; what makes one of it, of the logger so far and a seed.

    keeps: whether the information that tells faults apart is left in.
    """

    words: str
    apply: Callable[[Acquisition, int], Acquisition]
    keeps: bool = True


def trait_of(name: str) -> Trait:
    """The trait of that name, or the combination of several names joined by "+"."""
    names = name.split("+")
    unknown = [part for part in names if part not in TRAITS]
    if unknown:
        raise ValueError(f"no trait {', '.join(unknown)}: there are {', '.join(TRAITS)}")
    return TRAITS[name] if len(names) == 1 else combined(names)


def combined(names: Iterable[str]) -> Trait:
    """Several traits at once, applied in order. Each is drawn as in a logger that has it alone."""
    parts = [TRAITS[name] for name in names]
    return Trait(
        "; ".join(part.words for part in parts),
        lambda acquisition, seed: reduce(lambda so_far, part: part.apply(so_far, seed), parts, acquisition),
        all(part.keeps for part in parts),
    )


def acquisition_of(name: str, spec: TruthSpec, seed: int) -> Acquisition:
    """The spec's own logger with the traits of `name` on top, their sizes drawn by the seed."""
    return trait_of(name).apply(ideal(spec.logger), seed)


def make_log_with(name: str, spec: TruthSpec, seed: int) -> tuple[pd.DataFrame, dict]:
    """As `make_log`, through the logger with the traits of `name`. The truth has their sizes as "acquisition"."""
    return make_log_through(acquisition_of(name, spec, seed), spec, seed)


# --- what traits are made of -----------------------------------------------------------------------


def _about(rng: np.random.Generator, value: float, spread: float = 0.25) -> float:
    """A size within `spread` of a value, relative."""
    return float(value * rng.uniform(1.0 - spread, 1.0 + spread))


def _signed(rng: np.random.Generator, value: float) -> float:
    return _about(rng, value) * float(rng.choice((-1.0, 1.0)))


def _on(
    acquisition: Acquisition, channels: Iterable[str], change: Callable[[str, Chain], Chain]
) -> Acquisition:
    changed = {channel: change(channel, acquisition.chains[channel]) for channel in channels}
    return replace(acquisition, chains={**acquisition.chains, **changed})


def _clocked(acquisition: Acquisition, **fields: float) -> Acquisition:
    return replace(acquisition, clock=replace(acquisition.clock, **fields))


def _noise(times: float, acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    factor = _about(rng, times, 1.0 / 6.0)
    return _on(acquisition, CHANNELS, lambda _, chain: replace(chain, noise_std=factor * chain.noise_std))


def _steps(
    channels: Iterable[str], sigmas: float, acquisition: Acquisition, rng: np.random.Generator
) -> Acquisition:
    """Readings in steps of a converter, whose zero is no reading."""

    def stepped(channel: str, chain: Chain) -> Chain:
        step = _about(rng, sigmas * SIGMA[channel], 0.2)
        return replace(chain, step=step, step_origin=step * float(rng.uniform(-0.5, 0.5)))

    return _on(acquisition, channels, stepped)


def _written(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _on(acquisition, CHANNELS, lambda channel, chain: replace(chain, step=WRITTEN[channel]))


def _twelve_bits(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _on(
        acquisition,
        CHANNELS,
        lambda channel, chain: replace(chain, step=RANGES[channel] / 2**11, limit=RANGES[channel]),
    )


def _held(
    channels: Iterable[str], hz: float, acquisition: Acquisition, rng: np.random.Generator
) -> Acquisition:
    """One converter for these channels: they are read at the same instants."""
    phase = float(rng.uniform())
    return _on(acquisition, channels, lambda _, chain: replace(chain, hold_hz=hz, hold_phase=phase))


def _averaged(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _on(acquisition, ("position",), lambda _, chain: replace(chain, window_s=32 * SAMPLE_S))


def _low_pass(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    cutoff = _about(rng, 400.0, 0.1)
    return _on(acquisition, CHANNELS, lambda _, chain: replace(chain, cutoff_hz=cutoff))


def _hum(
    hz: float,
    harmonics: dict[int, float],
    amplitudes: dict[str, float],
    acquisition: Acquisition,
    rng: np.random.Generator,
) -> Acquisition:
    """Sines at `hz`, which wanders by a thousandth, and its harmonics, on the channels of `amplitudes`."""
    base = _about(rng, hz, 1e-3)

    def humming(channel: str, chain: Chain) -> Chain:
        size = _about(rng, amplitudes[channel])
        lines = (
            Line(order * base, size * share, float(rng.uniform(0.0, 2 * np.pi)))
            for order, share in harmonics.items()
        )
        return replace(chain, lines=(*chain.lines, *lines))

    return _on(acquisition, amplitudes, humming)


def _pwm(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    """The tenth multiple of the sample rate and 137 Hz: what is left of a PWM of 16 kHz."""
    line = Line(
        10 * SENSOR_BAND_HZ + _about(rng, 137.0, 0.05), _about(rng, 1e-3), float(rng.uniform(0.0, 6.0))
    )
    return _on(acquisition, ("current",), lambda _, chain: replace(chain, lines=(*chain.lines, line)))


def _wandering(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    sigmas, seconds = _about(rng, 2.0), _about(rng, 20e-3)
    return _on(
        acquisition,
        CHANNELS,
        lambda channel, chain: replace(chain, wander_std=sigmas * SIGMA[channel], wander_s=seconds),
    )


def _coloured(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    """Noise of the usual size, of which a sample keeps 0.75 of the one before."""
    seconds = -SAMPLE_S / np.log(_about(rng, 0.75, 0.05))
    return _on(
        acquisition,
        CHANNELS,
        lambda _, chain: replace(chain, noise_std=0.0, wander_std=chain.noise_std, wander_s=seconds),
    )


def _late(channel: str, samples: float, acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    delay = _about(rng, samples * SAMPLE_S, 0.2)
    return _on(acquisition, (channel,), lambda _, chain: replace(chain, delay_s=chain.delay_s + delay))


def _offsets(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    zero = {"voltage": _signed(rng, 30e-3), "current": _signed(rng, 2e-3)}
    return _on(acquisition, zero, lambda channel, chain: replace(chain, offset=zero[channel]))


def _spikes(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _on(
        acquisition,
        CHANNELS,
        lambda channel, chain: replace(
            chain, spike_share=1e-3, spike_size=float(rng.uniform(20.0, 100.0)) * SIGMA[channel]
        ),
    )


def _milliseconds(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _clocked(acquisition, resolution_s=1e-3, rate_hz=min(acquisition.clock.rate_hz, DECIMATED_HZ))


def _jitter(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _clocked(acquisition, jitter_s=_about(rng, 0.05 / acquisition.clock.rate_hz))


def _missing(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _clocked(acquisition, missing_share=_about(rng, 0.03))


def _slow(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _clocked(acquisition, rate_hz=200.0)


def _mid_move(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return _clocked(acquisition, skipped_s=float(rng.uniform(0.03, 0.25)))


def _switched_off(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return replace(acquisition, drive_off_s=50e-3)


def _without(column: str, acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    return replace(acquisition, absent=(*acquisition.absent, column))


def _range_switched(acquisition: Acquisition, rng: np.random.Generator) -> Acquisition:
    """Another range of one channel: four times its noise from somewhere in the middle of the log on."""
    channel, share = str(rng.choice(CHANNELS)), float(rng.uniform(0.3, 0.7))
    return _on(acquisition, (channel,), lambda _, chain: replace(chain, later_noise=4.0, later_share=share))


# --- the traits ------------------------------------------------------------------------------------

_DRAWS: dict[str, tuple[str, Draw]] = {
    "noise_3": ("noise three times the rig file's", partial(_noise, 3.0)),
    "noise_third": ("a third of the rig file's noise", partial(_noise, 1.0 / 3.0)),
    "steps_voltage": ("voltage in steps of one sigma", partial(_steps, ("voltage",), 1.0)),
    "steps_current": ("current in steps of one sigma", partial(_steps, ("current",), 1.0)),
    "steps_position": ("position in steps of one sigma", partial(_steps, ("position",), 1.0)),
    "steps_all": ("all channels in steps of one sigma", partial(_steps, CHANNELS, 1.0)),
    "steps_3_all": ("all channels in steps of three sigma", partial(_steps, CHANNELS, 3.0)),
    "csv_3_decimals": ("written to 1 mV, 1 mA and 10 um", _written),
    "twelve_bits": ("converter of 12 bits over ranges far above what is used", _twelve_bits),
    "position_100hz": ("position held at 100 Hz", partial(_held, ("position",), 100.0)),
    "position_50hz": ("position held at 50 Hz", partial(_held, ("position",), 50.0)),
    "position_60hz": (
        "position held at 60 Hz, no whole number of samples",
        partial(_held, ("position",), 60.0),
    ),
    "drive_400hz": ("current and voltage held at 400 Hz", partial(_held, ("voltage", "current"), 400.0)),
    "position_averaged": ("position averaged over 32 samples", _averaged),
    "low_pass": ("all channels behind a first-order low pass of 400 Hz", _low_pass),
    "hum_50hz": (
        "hum of 50 Hz: 2 mA, 40 mV",
        partial(_hum, 50.0, {1: 1.0}, {"voltage": 40e-3, "current": 2e-3}),
    ),
    "hum_60hz": (
        "hum of 60 Hz with 40 % of third harmonic: 2 mA, 40 mV",
        partial(_hum, 60.0, {1: 1.0, 3: 0.4}, {"voltage": 40e-3, "current": 2e-3}),
    ),
    "pwm_line": ("PWM folded to 137 Hz on the current: 1 mA", _pwm),
    "wandering": ("baseline that wanders: 2 sigma, 20 ms", _wandering),
    "coloured": ("noise with 0.75 of the sample before", _coloured),
    "current_late": ("current a quarter of a sample late", partial(_late, "current", 0.25)),
    "position_late": ("position half a sample late", partial(_late, "position", 0.5)),
    "voltage_late": ("voltage one sample late", partial(_late, "voltage", 1.0)),
    "offsets": ("zero offsets of 30 mV and 2 mA", _offsets),
    "spikes": ("one sample in 1000 a spike of 20 to 100 sigma", _spikes),
    "milliseconds": ("800 Hz, time stamps rounded to 1 ms", _milliseconds),
    "jitter": ("clock jitter of 5 % of a sample", _jitter),
    "missing_rows": ("3 % of the rows missing", _missing),
    "drive_off": ("drive switched off after 50 ms of rest", _switched_off),
    "no_voltage": ("no voltage column", partial(_without, COLUMNS["voltage"])),
    "no_command": ("no column of the commanded speed", partial(_without, "speed_cmd_rad_s")),
    "slow_200hz": ("logged at 200 Hz", _slow),
    "mid_move": ("log starts up to 250 ms into the move", _mid_move),
    "range_switched": ("noise of one channel grows fourfold mid-log", _range_switched),
    "position_5hz": ("position held at 5 Hz", partial(_held, ("position",), 5.0)),
    "position_steps_2mm": ("position in steps of 2 mm", partial(_steps, ("position",), 200.0)),
}
HIDING = ("position_5hz", "position_steps_2mm")  # they take the kink of the position away


def _drawn(name: str, draw: Draw, acquisition: Acquisition, seed: int) -> Acquisition:
    return draw(acquisition, np.random.default_rng([seed, crc32(name.encode())]))


IDEAL = Trait("ideal logger", lambda acquisition, seed: acquisition)
TRAITS = {
    "ideal": IDEAL,
    **{
        name: Trait(words, partial(_drawn, name, draw), name not in HIDING)
        for name, (words, draw) in _DRAWS.items()
    },
}
PAIRS = (
    "noise_3+steps_all",
    "hum_50hz+csv_3_decimals",
    "position_100hz+noise_3",
    "position_60hz+hum_60hz",
    "coloured+position_late",
    "wandering+missing_rows",
    "position_averaged+offsets",
    "twelve_bits+spikes",
)
TRIPLES = (
    "position_100hz+steps_all+hum_50hz",
    "noise_3+current_late+offsets",
    "low_pass+csv_3_decimals+jitter",
    "drive_400hz+pwm_line+missing_rows",
)
