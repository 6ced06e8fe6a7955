"""The logger: what it records of the motion, with sensor effects, white noise and the rounding of a DAQ."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.signal import lfilter, lfilter_zi

from .faults import Fault, spoil_channel
from .plant import Motion
from .rig import SCREW_LEAD_M

STEPS = {"voltage": 1e-4, "current": 1e-6, "position": 1e-8}  # V, A, m: what the logger resolves
COLUMNS = {"voltage": "voltage_v", "current": "current_a", "position": "position_m"}
ENCODER_EDGES_PER_TURN = 128  # 32 counts a turn, quadrature


@dataclass(frozen=True)
class Logger:
    """Sample rate and white noise, 1 sigma. log_encoder adds the servo's own angle, in quadrature steps.

    encoder_edges: steps a turn.
    """

    rate_hz: float = 1600.0
    voltage_noise_v: float = 10e-3
    current_noise_a: float = 0.3e-3
    position_noise_m: float = 10e-6
    pitch_noise_deg: float = 0.0
    log_encoder: bool = False
    encoder_edges: int = ENCODER_EDGES_PER_TURN

    def noiseless(self) -> "Logger":
        return Logger(self.rate_hz, 0.0, 0.0, 0.0, 0.0, self.log_encoder, self.encoder_edges)


class Sensors(NamedTuple):
    """What the sensors do to the truth, SI units with pitch in degrees. Defaults are neutral."""

    position_lag: float = 0.0
    position_delay: float = 0.0
    position_gain: float = 0.0
    position_ripple: float = 0.0
    position_ripple_period: float = SCREW_LEAD_M
    position_ripple_phase: float = 0.0
    position_creep: float = 0.0
    position_creep_time: float = 5.0
    position_per_degree: float = 0.0
    position_square: float = 0.0  # 1/m
    position_hysteresis: float = 0.0  # m
    position_hysteresis_way: float = 2e-4  # m, over which the magnet turns about
    position_ring: float = 0.0  # share of x that a frame which swings at 40 Hz puts in
    current_filter: float = 0.0  # s
    current_offset: float = 0.0
    current_gain: float = 0.0
    voltage_delay: float = 0.0
    voltage_offset: float = 0.0
    pitch_offset: float = 0.0


def needs_history(sensors: Sensors) -> bool:
    """Whether a sensor remembers what happened between two samples."""
    lags = (sensors.position_lag, sensors.position_delay, sensors.voltage_delay, sensors.current_filter)
    return max(lags) > 0.0 or sensors.position_hysteresis != 0.0 or sensors.position_ring != 0.0


def record(motion: Motion, times, pitch, command, Rs, sensors: Sensors, logger: Logger, fault: Fault, rng):
    """The log of the contract, section 1. motion: at `times` [s] or denser; pitch [deg], command [rad/s]."""
    clean = {channel: clean_channel(motion, channel, times, pitch, Rs, sensors) for channel in COLUMNS}
    noise = {
        "voltage": logger.voltage_noise_v * rng.standard_normal(times.size),
        "current": logger.current_noise_a * rng.standard_normal(times.size),
        "position": logger.position_noise_m * rng.standard_normal(times.size),
    }
    columns = {"time_s": np.round(times, 9)}
    for channel, column in COLUMNS.items():
        at_onset = 0.0 if fault.onset_s is None else np.interp(fault.onset_s, times, clean[channel])
        seen = spoil_channel(fault, channel, times, clean[channel], noise[channel], at_onset)
        columns[column] = rounded(seen, STEPS[channel])
    pitch_noise = logger.pitch_noise_deg * rng.standard_normal(times.size)
    columns["pitch_deg"] = rounded(pitch + sensors.pitch_offset + pitch_noise, 1e-3)
    columns["speed_cmd_rad_s"] = rounded(command, 1e-6)
    if logger.log_encoder:
        columns["encoder_rad"] = encoder_reading(motion, times, logger)
    return pd.DataFrame(columns)


def clean_channel(motion: Motion, channel: str, times, pitch, Rs, sensors: Sensors):
    """What the sensor of `channel` gives at `times` [s], without noise and rounding. pitch [deg]: at those times."""
    if channel == "voltage":
        return _voltage(motion, times, Rs, sensors)
    if channel == "current":
        i = motion.current
        if sensors.current_filter > 0.0:
            i = _lagged(motion, i, sensors.current_filter)
        return _at(motion, i, times) * (1.0 + sensors.current_gain) + sensors.current_offset
    return _position(motion, times, pitch, sensors)


def encoder_reading(motion: Motion, times, logger: Logger):
    """The servo's own angle in quadrature steps [rad]."""
    edge = 2 * np.pi / logger.encoder_edges
    return np.round(np.floor(_at(motion, motion.angle, times) / edge) * edge, 6)


def _voltage(motion, times, Rs, sensors):
    """Eq. 15: terminal voltage, seen voltage_delay seconds late."""
    terminal = motion.source_voltage - Rs * motion.current
    return _at(motion, terminal, times - sensors.voltage_delay) + sensors.voltage_offset


def _position(motion, times, pitch, sensors):
    """The absolute sensor: lag, delay, gain, periodic error, creep, pitch error, in that order."""
    x = motion.position
    if sensors.position_lag > 0.0:
        x = _lagged(motion, x, sensors.position_lag)
    if sensors.position_ring != 0.0:
        x = x + sensors.position_ring * _swinging(motion)
    if sensors.position_hysteresis != 0.0:
        x = x + sensors.position_hysteresis * _turned(motion.position, sensors.position_hysteresis_way)
    x = _at(motion, x, times - sensors.position_delay)
    ripple = np.sin(2 * np.pi * x / sensors.position_ripple_period + sensors.position_ripple_phase)
    creep = sensors.position_creep * (1.0 - np.exp(-times / sensors.position_creep_time))
    return (
        (1.0 + sensors.position_gain) * x
        + sensors.position_square * x**2
        + sensors.position_ripple * ripple
        + creep
        + sensors.position_per_degree * pitch
    )


def _lagged(motion, values, lag):
    """A first-order lag of `lag` seconds, bilinear: a ramp lags exactly."""
    ratio = 2.0 * lag / (motion.time[1] - motion.time[0])
    b, a = [1.0 / (1.0 + ratio)] * 2, [1.0, (1.0 - ratio) / (1.0 + ratio)]
    return lfilter(b, a, values, zi=lfilter_zi(b, a) * values[0])[0]


def _swinging(motion, hz=40.0, damping=0.05):
    """What a frame on springs adds to the place of the mass: its answer to the acceleration, as x in the limit of a rigid one."""
    h, w = motion.time[1] - motion.time[0], 2.0 * np.pi * hz
    b, a = [1.0, -2.0, 1.0], [1.0 + 2.0 * damping * w * h + (w * h) ** 2, -2.0 - 2.0 * damping * w * h, 1.0]
    return lfilter(b, a, motion.position - motion.position[0])


def _turned(x, way):
    """-1 to 1: how far a magnet with hysteresis has turned about since the last reversals."""
    state, out = 0.0, np.empty(x.size)
    for k, dx in enumerate(np.diff(x, prepend=x[0]).tolist()):
        state += (np.sign(dx) - state) * (1.0 - np.exp(-abs(dx) / way))
        out[k] = state
    return out


def _at(motion, values, times):
    return np.interp(times, motion.time, values)


def rounded(values, step):
    """Multiples of `step`, without the float dust that a plain product leaves and without minus zero."""
    return np.round(np.round(values / step) * step, int(round(-np.log10(step)))) + 0.0
