"""What the motor's own encoder says of a fault: the third way in which a log tells how far the motor turned.

Position, encoder, and voltage with current (equations 2 and 8) agree in a healthy move. Where two of them leave each other, the
third one says which is right. An encoder that goes with the position refutes a nut that slips and a coupling that is lost, and
says that voltage or current lie; one that goes with these refutes that they do.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used: `integrate` takes half a second

from observer_fi.numerics import filled, with_unit
from observer_fi.physics import Rig, speed
from observer_fi.records import Array, Event, Log, Outcome
from observer_fi.verdict.drift import SURE, mostly
from observer_fi.verdict.logger.left_out import shared

# Standard deviations of a position, and of the way, by which two ways must leave each other.
APART, SHARE = 5.0, 0.02
CALIBRATED = 4.0  # times as far went a mass that tells what the lead and the constants are
NEAR = 0.25  # of what they are apart, by which the third one is with one of them
ELECTRICAL = ("voltage", "current")
OF_THE_COUPLING = ("slip", "coupling_loss")
OF_A_LOAD = ("overload", "jam")
LOADED = 0.1  # of the way that a warmer winding takes from the circuit beside a load: no more
STEADY_S, FEWEST = 0.05, 20  # of one speed, and samples either side of an onset from which a current is told
# Over which an encoder's speed is taken; what of it is one speed; and of the fastest, what is motion.
MEAN_S, SAME, MOVES = 0.02, 0.05, 0.05
TOGETHER = (
    "encoder_rad goes with position_m, {} of {} that voltage_v and current_a say, so that nothing slips between "
    "motor and mass: one of these lies"
)
WITH_THE_MOTOR = "encoder_rad goes with voltage_v and current_a, so that neither of them lies"
EITHER = "which of voltage_v and current_a lies, this move does not tell"


class Ways(NamedTuple):
    """How far the mass went from an onset on until two ways were farthest apart [m]: by the position, the encoder, the circuit.

    rows: of the log, in between.
    """

    position: float
    encoder: float
    circuit: float
    rows: slice

    def side_of(self, one: float, other: float) -> bool:
        """Whether the encoder is with one and not with the other."""
        return abs(self.encoder - one) < NEAR * abs(one - other)


def by_the_encoder(outcome: Outcome, begin: Callable[[], Log], rig: Rig) -> Outcome:
    """The outcome with what an encoder refutes taken back. begin: the log's first samples at least."""
    found = outcome.isolation
    if found is None or outcome.log is None or not rig.driven.motor:
        return outcome
    asked = [e for e in found.events if {e.label, *e.alike} & {*OF_THE_COUPLING, *OF_A_LOAD, "sensor_fault"}]
    log = begin() if asked else None
    if log is None or log.encoder is None or not np.isfinite(log.encoder).any():
        return outcome
    if np.isnan(log.z).all(axis=0).any():
        return outcome
    log = replace(log, encoder=filled(log.encoder))
    for event in asked:
        told = _told(event, log, rig)
        if told is not event:
            outcome = shared(outcome, event, partial(_instead, told), rig)
    return outcome


def _instead(told: Event, _: Event) -> Event:
    return told


def _told(event: Event, log: Log, rig: Rig) -> Event:
    ways = _ways(event, log, rig)
    if ways is None:
        return event
    if ways.side_of(ways.position, ways.circuit):
        return _lies(event, ways, log, rig)
    if ways.side_of(ways.circuit, ways.position):
        return _is_right(event)
    return event


def _ways(event: Event, log: Log, rig: Rig) -> Ways | None:
    """The three ways behind an onset; None where they are not at hand, or two of them nowhere far apart."""
    if event.onset_s is None:
        return None
    first = int(np.searchsorted(log.t, event.onset_s))
    last = int(np.searchsorted(log.t, event.over_s or event.end_s, "right"))
    if last - first < FEWEST or event.end_s > log.t[-1]:
        return None
    turning = np.abs(_turning(log)[first:last])
    last = first + int(np.flatnonzero(turning >= MOVES * turning.max())[-1]) + 1
    begin = int(np.searchsorted(log.t, event.start_s))
    travels = _travels(log, slice(begin, last), rig, first - begin)
    if travels is None:
        return None
    x, encoder, circuit = travels
    apart = np.abs(circuit - x)[first - begin :]
    k = int(np.nanargmax(apart)) + first - begin
    way = max(abs(encoder[k]), abs(x[k]))
    if not abs(circuit[k] - x[k]) > max(APART * float(rig.noise_std[2]), SHARE * way):
        return None
    return Ways(float(x[k]), float(encoder[k]), float(circuit[k]), slice(first, last))


def _travels(log: Log, rows: slice, rig: Rig, onset: int) -> tuple[Array, Array, Array] | None:
    """How far the mass is from where it was at row `onset` of these [m], (n,) each over `MEAN_S`: see `Ways`.

    The lead and the motor's constants are as all three agree before it. None where the mass did not go far enough before, or
    the encoder did not go with it: it may be dead, or count in another unit.
    """
    assert log.encoder is not None
    z = np.column_stack([filled(channel) for channel in log.z[rows].T])
    D, mean = rig.model["D"], max(round(MEAN_S * log.rate_hz), 1)
    turned = np.asarray(
        scipy.integrate.cumulative_trapezoid(speed(z, rig.model.vector), log.t[rows], initial=0)
    )
    ways = [scipy.ndimage.uniform_filter1d(way, mean) for way in (z[:, 2], D * log.encoder[rows], D * turned)]
    x, *others = (way - way[onset] for way in ways)
    if abs(x[0]) < CALIBRATED * APART * float(rig.noise_std[2]) or not abs(
        others[0][0] - x[0]
    ) < LOADED * abs(x[0]):
        return None
    scales = (np.clip(x[0] / way[0] if way[0] else 1.0, 1.0 - LOADED, 1.0 + LOADED) for way in others)
    encoder, circuit = (way * scale for way, scale in zip(others, scales, strict=True))
    return x, encoder, circuit


def _lies(event: Event, ways: Ways, log: Log, rig: Rig) -> Event:
    """A fault behind which the encoder goes with the position: voltage or current lies, whatever it was called."""
    way = max(abs(ways.position), abs(ways.circuit))
    if event.label in OF_A_LOAD and abs(ways.circuit - ways.position) < LOADED * way:
        return event
    if event.channel in ELECTRICAL and not set(event.alike) & {*OF_THE_COUPLING}:
        return event
    why = TOGETHER.format(with_unit(ways.encoder, "m"), with_unit(ways.circuit, "m"))
    channel = event.channel if event.channel in ELECTRICAL else _liar(ways, log, rig)
    sure = SURE if channel else 0.5
    told = event._replace(
        label="sensor_fault", channel=channel or ELECTRICAL[0], severity=(), alike=(), then=()
    )
    posterior = mostly("sensor_fault", told)
    reasons = (why, *(() if channel else (EITHER,)))
    return told._replace(
        probability=sure,
        posterior=posterior,
        reasons=reasons,
        isolated_s=event.isolated_s if channel else None,
    )


def _is_right(event: Event) -> Event:
    """A fault behind which the encoder goes with the circuit: of two as likely, none in which voltage or current lies."""
    others = tuple(label for label in event.alike if label in OF_THE_COUPLING)
    if event.channel not in ELECTRICAL or not others:
        return event
    share = SURE / len(others)
    posterior = mostly(others[0], event) | dict.fromkeys(others, share)
    told = event._replace(label=others[0], channel=None, alike=others[1:], posterior=posterior)
    return told._replace(probability=share, reasons=(*event.reasons, WITH_THE_MOTOR))


def _liar(ways: Ways, log: Log, rig: Rig) -> str | None:
    """Which of voltage and current lies: the current of a steady motion is as before if it is the voltage, None if neither fits.

    What equation 2 is off by, in the winding, is what a current that lies reads more.
    """
    before, after = _steady(log, ways.rows)
    if before is None or after is None:
        return None
    R, Km = rig.model["Rm"], rig.model["Km"]
    turned = _turning(log)
    off = np.nanmedian(log.z[after, 0] - R * log.z[after, 1]) - Km * np.median(turned[after])
    off -= np.nanmedian(log.z[before, 0] - R * log.z[before, 1]) - Km * np.median(turned[before])
    changed = float(np.nanmedian(log.z[after, 1]) - np.nanmedian(log.z[before, 1]))
    more = -float(off) / R
    if abs(changed) < NEAR * abs(more):
        return "voltage"
    return "current" if abs(changed - more) < NEAR * abs(more) else None


def _steady(log: Log, rows: slice) -> tuple[Array | None, Array | None]:
    """Samples of one speed before the rows and within them; None where they are few."""
    turned, reach = _turning(log), rows.stop - rows.start + int(STEADY_S * log.rate_hz)
    value = float(np.median(turned[rows]))
    same = np.flatnonzero(np.abs(turned - value) < SAME * abs(value))
    own = same[(same >= rows.start) & (same < rows.stop)]
    before = same[(same < rows.start) & (same >= rows.start - reach)]
    return (before if before.size >= FEWEST else None), (own if own.size >= FEWEST else None)


def _turning(log: Log) -> Array:
    """(n,) speed of the encoder over `MEAN_S` [rad/s], which has steps."""
    assert log.encoder is not None
    half = max(round(0.5 * MEAN_S * log.rate_hz), 1)
    k = np.arange(log.t.size)
    ahead, behind = np.minimum(k + half, log.t.size - 1), np.maximum(k - half, 0)
    return np.asarray((log.encoder[ahead] - log.encoder[behind]) / (log.t[ahead] - log.t[behind]))
