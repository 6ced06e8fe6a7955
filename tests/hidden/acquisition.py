"""What lies between a sensor and the file: holds, averaging, lines, colour, delays, steps, and the logger's clock.

The motion is that of every integration step: delays, averages and holds act on it, not on samples of it. Noise comes
before the rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.signal import lfilter, lfilter_zi

from .faults import CHANNELS, Fault, spoil_channel
from .plant import Motion
from .sensors import COLUMNS, STEPS, Logger, Sensors, clean_channel, encoder_reading, rounded

SENSOR_BAND_HZ = 1600.0  # a sensor's white noise has its 1 sigma in half of this band
FILE_DECIMALS = 9  # of a reading in steps that are no power of ten


class Line(NamedTuple):
    """A sine on top of the signal: its true frequency [Hz], which sampling may fold, amplitude (V, A or m), phase [rad]."""

    hz: float
    amplitude: float
    phase: float


@dataclass(frozen=True)
class Chain:
    """What one channel goes through, in this order. V, A or m; the defaults but noise_std are neutral.

    delay_s: how late it is. noise_std: white; later_noise: by what it grows from `later_share` of the log on. offset, lines: on
    top of it. wander_std, wander_s: a baseline that wanders, exponential correlation. cutoff_hz: low pass of first order;
    window_s: moving average. hold_hz: how often a new reading comes, which is held until the next; hold_phase: in shares of that
    period. spike_share, spike_size: of the readings that are hit. limit: where readings clip. step, step_origin: of what readings
    are multiples, None for the file's own digits.
    """

    noise_std: float
    later_noise: float = 1.0
    later_share: float = 1.0
    delay_s: float = 0.0
    offset: float = 0.0
    lines: tuple[Line, ...] = ()
    wander_std: float = 0.0
    wander_s: float = 0.0
    cutoff_hz: float = 0.0
    window_s: float = 0.0
    hold_hz: float = 0.0
    hold_phase: float = 0.0
    spike_share: float = 0.0
    spike_size: float = 0.0
    limit: float = np.inf
    step: float | None = None
    step_origin: float = 0.0


@dataclass(frozen=True)
class Clock:
    """When samples are taken and what the file says of it.

    jitter_s: 1 sigma of the instants, stamped as they were. resolution_s: of the stamps, None for nanoseconds. missing_share: of
    the rows. skipped_s: how long after the first move has begun the log begins, None for at zero.
    """

    rate_hz: float = 1600.0
    jitter_s: float = 0.0
    resolution_s: float | None = None
    missing_share: float = 0.0
    skipped_s: float | None = None


@dataclass(frozen=True)
class Acquisition:
    """A logger as it is: a chain a channel, a clock, columns that it does not write.

    drive_off_s: after so long without a commanded speed the drive is switched off, and voltage and current are zero.
    """

    chains: dict[str, Chain]
    clock: Clock = field(default_factory=Clock)
    absent: tuple[str, ...] = ()
    drive_off_s: float = np.inf


def ideal(logger: Logger) -> Acquisition:
    """The acquisition that does nothing but what `logger` does."""
    noise = (logger.voltage_noise_v, logger.current_noise_a, logger.position_noise_m)
    chains = {channel: Chain(std) for channel, std in zip(CHANNELS, noise, strict=True)}
    return Acquisition(chains, Clock(logger.rate_hz))


class Scene(NamedTuple):
    """What there is to record. motion: at every step; pitch [deg], command [rad/s]: of an array of times [s]; Rs [ohm]."""

    motion: Motion
    pitch: Callable[[np.ndarray], np.ndarray]
    command: Callable[[np.ndarray], np.ndarray]
    Rs: float
    sensors: Sensors
    logger: Logger
    fault: Fault

    @property
    def duration_s(self) -> float:
        return float(self.motion.time[-1])


def record_through(scene: Scene, acquisition: Acquisition, times: np.ndarray, seed: int):
    """The log of the contract and how many spikes each channel has in it. times: of a regular clock [s]."""
    rng = np.random.default_rng(seed)
    white = {channel: rng.standard_normal(times.size) for channel in CHANNELS}
    own = np.random.default_rng([seed, 41])
    instants = _instants(acquisition.clock, times, own)
    columns, hit = {"time_s": _stamps(acquisition.clock, instants)}, {}
    for channel in CHANNELS:
        values, spiked = _recorded(scene, acquisition, channel, instants, white[channel], own)
        columns[COLUMNS[channel]], hit[channel] = values, spiked
    pitch = scene.pitch(instants)
    pitch_noise = scene.logger.pitch_noise_deg * rng.standard_normal(times.size)
    columns["pitch_deg"] = rounded(pitch + scene.sensors.pitch_offset + pitch_noise, 1e-3)
    columns["speed_cmd_rad_s"] = rounded(scene.command(instants), 1e-6)
    if scene.logger.log_encoder:
        columns["encoder_rad"] = encoder_reading(scene.motion, instants, scene.logger)
    kept = _kept(scene, acquisition.clock, instants, own)
    frame = pd.DataFrame(columns)[kept].drop(columns=list(acquisition.absent)).reset_index(drop=True)
    return frame, {channel: int(np.count_nonzero(spiked[kept])) for channel, spiked in hit.items()}


def _instants(clock: Clock, times, rng):
    """When samples are taken [s]: jitter never lets two of them change places."""
    apart = 0.45 / clock.rate_hz
    return times + np.clip(clock.jitter_s * rng.standard_normal(times.size), -apart, apart) * (times > 0.0)


def _stamps(clock: Clock, instants):
    if clock.resolution_s is None:
        return np.round(instants, 9)
    return np.round(np.round(instants / clock.resolution_s) * clock.resolution_s, 9)


def _kept(scene: Scene, clock: Clock, instants, rng):
    """Which rows reach the file: the first always does."""
    kept = rng.random(instants.size) >= clock.missing_share
    if clock.skipped_s is not None:
        moving = instants[np.flatnonzero(scene.command(instants))[0]]
        kept &= instants >= moving + clock.skipped_s
    else:
        kept[0] = True
    return kept


def _recorded(scene: Scene, acquisition: Acquisition, channel: str, instants, white, rng):
    """One column, and which of its samples are spikes. white: (n,) of unit variance, for readings at the instants."""
    chain = acquisition.chains[channel]
    ticks, which = _ticks(chain, instants)
    if chain.hold_hz:
        white = rng.standard_normal(ticks.size)
    if chain.cutoff_hz or chain.window_s:
        seen = _smoothed(scene, acquisition, channel, ticks, rng)
    else:
        seen = _sensed(scene, acquisition, channel, ticks, white, rng)
    spiked = rng.random(ticks.size) < chain.spike_share
    seen = seen + spiked * chain.spike_size * rng.choice((-1.0, 1.0), ticks.size)
    return _stepped(channel, chain, np.clip(seen, -chain.limit, chain.limit))[which], spiked[which]


def _ticks(chain: Chain, instants):
    """When the channel is read [s], and which of these readings stands in each row."""
    if not chain.hold_hz:
        return instants, np.arange(instants.size)
    latest = np.floor(instants * chain.hold_hz - chain.hold_phase + 1e-9)
    numbers, which = np.unique(latest, return_inverse=True)
    return (numbers + chain.hold_phase) / chain.hold_hz, which


def _sensed(scene: Scene, acquisition: Acquisition, channel: str, at, white, rng):
    """The channel at times `at` [s], before it is smoothed, held or rounded."""
    chain = acquisition.chains[channel]
    then = at - chain.delay_s
    clean = clean_channel(scene.motion, channel, then, scene.pitch(then), scene.Rs, scene.sensors)
    if channel != "position" and np.isfinite(acquisition.drive_off_s):
        clean = np.where(_switched_off(scene, acquisition.drive_off_s, then), 0.0, clean)
    later = np.where(at >= chain.later_share * scene.duration_s, chain.later_noise, 1.0)
    at_onset = 0.0 if scene.fault.onset_s is None else np.interp(scene.fault.onset_s, then, clean)
    noise, wander = chain.noise_std * later * white, 0.0
    if chain.wander_std:
        wander = np.interp(at, scene.motion.time, _wander(chain, scene.motion.time, rng))
    if not chain.noise_std:  # all the noise that the sensor has, and what a failing one has more of
        noise, wander = wander, 0.0
    seen = spoil_channel(scene.fault, channel, then, clean, noise, at_onset) + wander
    for line in chain.lines:
        seen = seen + line.amplitude * np.sin(2 * np.pi * line.hz * at + line.phase)
    return seen + chain.offset


def _switched_off(scene: Scene, after_s: float, times):
    """Where no speed has been commanded for `after_s`; before the first move none ever was."""
    grid = scene.motion.time
    latest = np.maximum.accumulate(np.where(scene.command(grid) != 0.0, grid, -np.inf))
    known = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 1)
    return times - latest[known] > after_s


def _wander(chain: Chain, grid, rng):
    """A process with the correlation exp(-lag / wander_s) on a regular grid."""
    keep = np.exp(-(grid[1] - grid[0]) / chain.wander_s)
    drive = np.sqrt(1.0 - keep**2) * rng.standard_normal(grid.size)
    drive[0] = rng.standard_normal()
    return chain.wander_std * lfilter([1.0], [1.0, -keep], drive)


def _smoothed(scene: Scene, acquisition: Acquisition, channel: str, at, rng):
    """The channel at times `at` [s] behind its low pass and its moving average, which see every step of the motion."""
    chain, grid = acquisition.chains[channel], scene.motion.time
    step = grid[1] - grid[0]
    white = rng.standard_normal(grid.size) / np.sqrt(SENSOR_BAND_HZ * step)
    before = int(0.1 / step)  # the log begins at rest: its mirror image is what came before
    seen = np.pad(_sensed(scene, acquisition, channel, grid, white, rng), (before, 0), mode="reflect")
    if chain.cutoff_hz:
        ratio = 1.0 / (np.pi * chain.cutoff_hz * step)
        b, a = (
            [1.0 / (1.0 + ratio)] * 2,
            [1.0, (1.0 - ratio) / (1.0 + ratio)],
        )  # bilinear: a ramp lags exactly
        seen, _ = lfilter(b, a, seen, zi=lfilter_zi(b, a) * seen[0])
    if chain.window_s:
        width = int(round(chain.window_s / step))
        total = np.concatenate(([0.0], np.cumsum(seen - seen[0])))
        seen = seen[0] + np.append(np.zeros(width - 1), (total[width:] - total[:-width]) / width)
    return np.interp(at, grid, seen[before:])


def _stepped(channel: str, chain: Chain, seen):
    if chain.step is None:
        return rounded(seen, STEPS[channel])
    steps = np.round((seen - chain.step_origin) / chain.step)
    return np.round(steps * chain.step + chain.step_origin, FILE_DECIMALS) + 0.0


def true_sizes(acquisition: Acquisition, spikes: dict[str, int]) -> dict[str, dict]:
    """What a reader of the log should find, by column and for "clock", V, A, m and s.

    noise_std: of the white part, of one reading. correlation_s: integral of the correlation of the coloured part, wander_std its
    1 sigma. delay_s: against the motion; a held reading is older still by its age. lines: (Hz as read, amplitude) of
    the readings, fresh ones where they are held.
    """
    told: dict[str, dict] = {
        COLUMNS[channel]: _channel_sizes(chain, acquisition.clock, spikes[channel])
        for channel, chain in acquisition.chains.items()
        if COLUMNS[channel] not in acquisition.absent
    }
    clock = acquisition.clock
    told["clock"] = {
        "rate_hz": clock.rate_hz,
        "jitter_s": clock.jitter_s,
        "resolution_s": clock.resolution_s,
        "missing_share": clock.missing_share,
    }
    return told


def _channel_sizes(chain: Chain, clock: Clock, spikes: int) -> dict:
    rate = chain.hold_hz or clock.rate_hz
    lag = 1.0 / (2 * np.pi * chain.cutoff_hz) if chain.cutoff_hz else 0.0
    correlation = chain.wander_s or 0.5 * chain.window_s or lag
    return {
        "noise_std": chain.noise_std * _passed_noise(chain),
        "later_noise": chain.later_noise,
        "resolution": chain.step,
        "update_hz": chain.hold_hz or None,
        "lines": [(_folded(line.hz, rate), line.amplitude * _gain(chain, line.hz)) for line in chain.lines],
        "correlation_s": correlation or None,
        "wander_std": chain.wander_std,
        "delay_s": chain.delay_s + 0.5 * chain.window_s + lag,
        "averaged_s": chain.window_s or None,
        "offset": chain.offset,
        "spikes": spikes,
    }


def _passed_noise(chain: Chain) -> float:
    """Share of the white noise that the smoothing lets through, low pass or average."""
    if chain.window_s:
        return float(1.0 / np.sqrt(SENSOR_BAND_HZ * chain.window_s))
    return float(np.sqrt(np.pi * chain.cutoff_hz / SENSOR_BAND_HZ)) if chain.cutoff_hz else 1.0


def _gain(chain: Chain, hz: float) -> float:
    """Share of a line that the smoothing lets through."""
    low_pass = 1.0 / np.hypot(1.0, hz / chain.cutoff_hz) if chain.cutoff_hz else 1.0
    return float(low_pass * abs(np.sinc(hz * chain.window_s)))


def _folded(hz: float, rate_hz: float) -> float:
    """The frequency at which a line shows when it is read `rate_hz` times a second."""
    return abs(hz - rate_hz * round(hz / rate_hz))
