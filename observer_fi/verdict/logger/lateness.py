"""How late a logger's channels are against each other, measured at the first start of a log, and readings set right.

A start, or the first stop of a log that begins under way, is where readings change most from sample to sample: there the
nominal hypothesis tells delays of a tenth of a sample. Channels that are early are set back to the latest of voltage and
current, so that no later sample is needed; what that one is behind the command is a delay of the servo's input, and a position
that is later still a delay of its sensor.
"""

from collections.abc import Callable

import numpy as np

from observer_fi.bank import Bank
from observer_fi.logs import SHORTEST_REST, Lateness, SetBack, moves_from_rest, quiet_speed
from observer_fi.physics import Rig, with_values
from observer_fi.records import Array, Log
from observer_fi.settings import BankSettings

BEFORE_S, AFTER_S, STEADY_S = 0.12, 0.25, 0.08  # of the start of a move, and its last part, without a ring
RISEN = 0.9  # of a speed: a loop creeps up to the rest of it
FEWEST = 60  # samples in motion there: of a slow logger those of a longer time
NOTICED_NATS = 40.0  # that a delay must be worth
LEAST = 0.08  # of a sample
FIRST_LOOK = 0.25  # samples
# Times its expected NIS: a start that nominal explains has no delays, and one that it does not explain with them has a fault.
FITS = 1.6
RELATIVE = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
AROUND, AROUND_POINTS = 0.4, 4  # samples around a delay, and so many on either side
COMMON = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
FIRST_LOOK_OF_POSITION = (4.0, 16.0)
NOTICED_OF_POSITION = 15.0  # nats: it changes little in a start
OF_POSITION = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


def set_right(rig: Rig, late: Lateness, interval: float) -> Rig:
    """The rig whose servo and position sensor are as late as what `SetBack` leaves of the readings. interval: [s]."""
    if not any(late):
        return rig
    common, model = late.electrical, rig.model
    return with_values(rig, {
        "input_delay": model["input_delay"] + common * interval,
        "position_delay": model["position_delay"] + max(late.position - common, 0.0) * interval,
    })  # fmt: skip


def lateness_of(log: Log, rig: Rig, settings: BankSettings, known: Lateness) -> Lateness:
    """How late the channels of a log are; what is `known` where neither its first start nor its first stop tells.

    Where nothing is known of a servo, voltage and current are late against each other only.
    """
    cut = first_start(log) or _first_stop(log)
    if cut is None or not rig.driven.motor or not np.isfinite(log.z[:, :2]).any(axis=0).all():
        return known
    gain = _Gains(cut, rig, settings)
    if not rig.watched.servo:
        best = _electrical(gain, known, common=(0.0,))
        return best if best == known else _on_top(gain, best)
    best = _electrical(gain, known)
    return best if known.position else _position(gain, best)


def _electrical(gain: "_Gains", nothing: Lateness, common: tuple[float, ...] = COMMON) -> Lateness:
    """Delays of voltage and current, the position beside them; nothing: where they do not tell.

    common: samples, that both may be behind the command; 0 alone where nothing checks that.
    """
    known = _parts(nothing)
    near = max(gain(_shifted(**(known | {"r": known["r"] + r}))) for r in (-FIRST_LOOK, FIRST_LOOK)) - gain(
        nothing
    )
    if near < NOTICED_NATS and gain.misfit(nothing) < FITS:
        return nothing
    best = _best(gain, nothing, "r", RELATIVE)
    best = _best(gain, best, "common", common)
    best = _finer(gain, _finer(gain, best, "r", 0.25), "r", 0.08)
    best = _finer(gain, best, "common", 0.25) if any(common) else best
    best = _finer(gain, best, "r", 0.05)
    better = gain(best) - gain(nothing) > NOTICED_NATS and best.electrical >= LEAST
    return best if better and gain.explains(best) else nothing


def _position(gain: "_Gains", best: Lateness) -> Lateness:
    """The same with the delay of the position, where it has one of samples."""
    later = _best(gain, best, "position", FIRST_LOOK_OF_POSITION)
    if later is best:
        return best
    later = _best(gain, best, "position", OF_POSITION)
    later = _finer(gain, later, "position", 0.5 * _parts(later)["position"])
    better = gain(later) - gain(best) > NOTICED_OF_POSITION
    return later if better and gain.explains(later) else best


def first_start(log: Log, risen: bool = False) -> Log | None:
    """The first start from rest with enough rest before it, None where there is none.

    risen: a soft one until as long after its speed has been reached.
    """
    for move in moves_from_rest(log):
        begun = log.t[_top(log.w_cmd, move.start) if risen else move.start]
        since, until = np.searchsorted(log.t, (log.t[move.start] - BEFORE_S, begun + AFTER_S))
        first = max(min(int(since), move.start - SHORTEST_REST), move.rest)
        last = min(max(int(until), move.start + FEWEST), move.stop)
        if move.start - first >= SHORTEST_REST and last - move.start >= FEWEST:
            return log.part(slice(first, last))
    return None


def _top(w_cmd: Array, start: int) -> int:
    """The sample at which a commanded speed that begins at `start` has risen, but for the last of it, without a pause."""
    speed = np.abs(w_cmd[start:])
    top = speed[int(np.argmin(np.append(np.diff(speed) > 0.0, False)))]
    return start + int(np.argmax(speed >= RISEN * top))


def _first_stop(log: Log) -> Log | None:
    """The first stop of a log that begins under way, with enough of the motion and of the rest, None where there is none."""
    t, w = log.t, log.w_cmd
    changes = np.flatnonzero(w != w[0])
    if w[0] == 0.0 or not changes.size:
        return None
    brakes = int(changes[0])
    rest = brakes + int(np.argmax(w[brakes:] == 0.0))
    again = np.flatnonzero(w[rest:] != 0.0)
    end = rest + int(again[0]) if again.size else t.size
    first, last = np.searchsorted(t, (t[brakes] - BEFORE_S, t[brakes] + AFTER_S))
    enough = brakes - first >= FEWEST and min(last, end) - brakes >= FEWEST
    return log.part(slice(int(first), int(min(last, end)))) if enough else None


class _Gains:
    """Nats by which delays explain a start, or a stop, better than none, and how well nominal then fits: its NIS over its
    expectation.
    """

    def __init__(self, log: Log, rig: Rig, settings: BankSettings) -> None:
        self.log, self.rig, self.settings = log, rig, settings
        self.interval = float(np.median(np.diff(log.t)))
        self.known: dict[Lateness, tuple[float, float]] = {}
        self.of_a_fault = -np.inf
        self.calm: dict[tuple[float, float], float] = {}
        self._of(Lateness())

    def __call__(self, late: Lateness) -> float:
        return self._of(late)[0] - self._of(Lateness())[0]

    def explains(self, late: Lateness) -> bool:
        """Whether nominal with these delays fits, and better than any fault without them."""
        nats, misfit = self._of(late)
        return misfit < FITS and nats > self.of_a_fault

    def misfit(self, late: Lateness) -> float:
        """NIS of nominal in motion with these delays, over its expectation."""
        return self._of(late)[1]

    def _of(self, late: Lateness) -> tuple[float, float]:
        if late not in self.known:
            self.known[late] = self._tried(late)
        return self.known[late]

    def _tried(self, late: Lateness) -> tuple[float, float]:
        """Log-likelihood of the start or stop, less that of as many calm samples: what mixing of samples makes of the noise is no
        gain.

        Calm are those before it, and the last ones, those of steady motion or of the other rest, where noise may be more. A
        delay of the position is the model's and mixes nothing: what it spoils of a motion that is not steady yet must not lower
        what calm samples are worth.
        """
        rig = set_right(self.rig, late, self.interval)
        log = SetBack(late).take(self.log)
        e = Bank(rig, self.settings).advance(log)
        moving = np.cumsum(np.abs(log.w_cmd - log.w_cmd[0]) > quiet_speed(log.w_cmd)) > 0
        before = ~moving
        before[:8] = False
        steady = self.log.t > self.log.t[-1] - STEADY_S
        nis = e.nis[moving, 0] / np.maximum(np.isfinite(log.z[moving]).sum(axis=1), 1)
        usual = max(float(e.density[part, 0].mean()) for part in (before, steady) if part.any())
        calm = self.calm.setdefault((late.voltage, late.current), usual)
        nats = e.density[moving].sum(axis=0) - calm * moving.sum()
        if not self.known:  # as the readings are
            self.of_a_fault = float(nats[1:].max())
        return float(nats[0]), float(np.nanmean(nis)) if np.isfinite(nis).any() else np.nan


def _shifted(r: float = 0.0, common: float = 0.0, position: float = 0.0) -> Lateness:
    """Delays with current r samples behind voltage (before it where negative), both by `common` more, position by its own."""
    return Lateness(common + max(-r, 0.0), common + max(r, 0.0), common + position)


def _parts(late: Lateness) -> dict[str, float]:
    common = min(late.voltage, late.current)
    return {"r": late.current - late.voltage, "common": common, "position": late.position - common}


def _best(
    gain: Callable[[Lateness], float], late: Lateness, part: str, values: tuple[float, ...]
) -> Lateness:
    """The best of some values of one part of the delays."""
    tried = [_shifted(**(_parts(late) | {part: value})) for value in values]
    return max([late, *tried], key=gain)


def _on_top(gain: Callable[[Lateness], float], late: Lateness) -> Lateness:
    """Delays with the current behind the voltage as the parabola through the gains around them has it: a current that no servo
    explains follows its readings from sample to sample, and the gains of single delays scatter by that.
    """
    r = _parts(late)["r"]
    off = np.linspace(-AROUND, AROUND, 2 * AROUND_POINTS + 1)
    a, b, _ = np.polyfit(off, [gain(_shifted(**(_parts(late) | {"r": r + d}))) for d in off], 2)
    if a >= 0.0:
        return late
    return _shifted(**(_parts(late) | {"r": r + float(np.clip(-0.5 * b / a, -AROUND, AROUND))}))


def _finer(gain: Callable[[Lateness], float], late: Lateness, part: str, step: float) -> Lateness:
    """The best one a step to either side, half a step, a quarter."""
    for width in (step, 0.5 * step):
        at = _parts(late)[part]
        values = [v for v in (at - width, at + width) if part == "r" or v >= 0.0]
        late = _best(gain, late, part, tuple(values))
    return late
