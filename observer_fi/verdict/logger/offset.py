"""Zero offset of the voltage, as the first rest of a log tells it, and whether the motion before that rest bears it out."""

import math

import numpy as np

from observer_fi.logs import OFF_ZERO, SHORTEST_REST, STANDING, rests_of
from observer_fi.numerics import in_python
from observer_fi.physics import Rig, equations
from observer_fi.records import Acquisition, ChannelTraits, Log

MOVING_S = 0.5  # of motion that is looked at
DOUBT = 0.02  # of its voltage, which gains and constants leave open


def electrical_offset(a: Acquisition, rig: Rig, gain: float = 1.0, least: float = OFF_ZERO) -> float:
    """Zero offset of the voltage against the current [V]: at rest equation 16 leaves their resistance only.

    Of two offsets only this sum shows in the motor's voltage balance; what is left of the current's is like friction.
    gain: of the voltage's readings, which are divided by it; least: of the noise of a reading, below which it is 0.
    """
    if not rig.driven.motor:
        return 0.0
    model = rig.model
    current = (a.current.offset - model["current_offset"]) / model["current_gain"]
    expected = in_python(equations.terminal_voltage)(current, 0.0, 0.0, model.vector)
    off = float(a.voltage.offset / gain - expected - model["voltage_offset"])
    noise = math.hypot(a.voltage.as_white, model["Rm"] * a.current.as_white)
    rounded = _rounding(a.voltage) + model["Rm"] * _rounding(a.current)
    return off if math.isfinite(off) and abs(off) > max(least * noise, rounded) else 0.0


def _rounding(channel: ChannelTraits) -> float:
    """By how much the mean of readings that stand still may be off, half their step; 0 where noise takes them over the steps."""
    step = channel.resolution or 0.0
    return 0.5 * step if step > STANDING * channel.noise_std else 0.0


def as_in_motion(a: Acquisition, log: Log, rig: Rig) -> Acquisition:
    """The acquisition without the offsets of a rest that the motion before it contradicts: a sensor has failed in between.

    For logs that begin in motion. What is off zero from the first sample on is so in motion, too.
    """
    offset = electrical_offset(a, rig)
    rests = rests_of(log.t, log.w_cmd, SHORTEST_REST) if offset and rig.driven.servo else []
    left = _left_in_motion(log.part(slice(0, rests[0].start)), rig) if rests else None
    if left is None or abs(left[0] - offset) <= abs(left[0]) + left[1]:
        return a
    voltage, current = (channel._replace(offset=0.0) for channel in a[:2])
    return a._replace(voltage=voltage, current=current)


def _left_in_motion(log: Log, rig: Rig) -> tuple[float, float] | None:
    """What equation 16 leaves of the voltage at the beginning of a log that moves steadily, and the doubt about it [V]."""
    steady = (log.w_cmd != 0.0) & (np.diff(log.w_cmd, prepend=log.w_cmd[:1]) == 0.0)
    told = np.flatnonzero(steady & np.isfinite(log.z[:, :2]).all(axis=1))
    told = told[log.t[told] < log.t[told[:1]] + MOVING_S]
    if told.size < SHORTEST_REST:
        return None
    V, i = np.median(log.z[told, :2], axis=0)
    expected = in_python(equations.terminal_voltage)(i, log.w_cmd[told].mean(), 0.0, rig.model.vector)
    return float(V - expected), DOUBT * abs(float(V))
