"""What a better model is worth on measured moves that its fit never saw, and which rig file is handed over.

The moves of the logs should be healthy. Each is diagnosed as a log of its own, with the rig file, the refitted and the
extended rig, the constants of the latter two fitted without it; what is never fitted with a move cannot remember it.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from observer_fi.improve.moves.simulated_moves import SimulatedMoves
from observer_fi.improve.steps import Ladder
from observer_fi.learn import FitResult, without_moves
from observer_fi.logs import SET_UP_DEG, moves_from_rest, settling_time
from observer_fi.physics import NOMINAL, Rig, with_values
from observer_fi.records import Array, Log, Segment
from observer_fi.settings import Settings
from observer_fi.verdict import describes, diagnose_log

MOST_MOVES = 12  # that are diagnosed, from the whole of the logs
SHOWN = 2  # moves that every rig is asked about, for the record: one in doubt takes many seconds
ENOUGH = 3  # alarms of a rig that tell how it does
_TOGETHER = 2  # moves asked at once: filters leave the interpreter's lock
_REST_S = 1.0  # of the rests around a move
_SHORTEST_S = 0.1  # of the rest before a move: tells the noise


class Count(NamedTuple):
    """Measured healthy moves that no fit saw, and how many of them `diagnose` calls faulty."""

    moves: int
    false_alarms: int


class NewMoves(NamedTuple):
    """By rig: its file as given, refitted, extended. best: the name of the one that is handed over."""

    rig_file: Count
    refit: Count
    extended: Count
    best: str


UNSEEN = NewMoves(Count(0, 0), Count(0, 0), Count(0, 0), "extended")


def new_moves(problem: SimulatedMoves, ladder: Ladder[FitResult], given: Rig) -> NewMoves:
    """`diagnose` on moves that no fit saw; of rigs that do equally well there, the one that explains held-out moves best."""
    chosen = np.unique(np.linspace(0, problem.experiment.moves - 1, MOST_MOVES).astype(int)).tolist()
    parts = [(m, part) for m in chosen for part in (_part(problem, m),) if part is not None]
    extended = problem.extended_rig(ladder)
    rigs: dict[str, Callable[[int], Rig]] = {
        "rig_file": lambda m: given,
        "refit": lambda m: _without(problem.written, ladder.baseline, m),
        "extended": lambda m: _without(extended, ladder.extended, m),
    }
    if not ladder.steps:  # nothing was named: the extended rig is the refitted one
        del rigs["extended"]
    worse = problem.measure(ladder.extended).nll_per_sample > problem.measure(ladder.baseline).nll_per_sample
    order = ("refit", "extended", "rig_file") if worse else ("extended", "refit", "rig_file")
    counts = counted({name: rigs[name] for name in order if name in rigs}, parts, _is_alarm)
    counts.setdefault("extended", counts["refit"])
    return NewMoves(**counts, best=best_of(counts, order))


def best_of(counts: Mapping[str, Count], order: Sequence[str]) -> str:
    """The first rig in order, best on held-out moves first, that has no more false alarms than any other but for one.

    One among a few moves is chance, and a rig that fits nothing has room for everything.
    """
    least = min(map(_rate, counts.values()))
    return next(n for n in order if _rate(counts[n]) <= least + 1.0 / max(counts[n].moves, 1))


def counted(
    rigs: Mapping[str, Callable[[int], Rig]],
    parts: Sequence[tuple[int, Log]],
    is_alarm: Callable[[Log, Rig], bool],
) -> dict[str, Count]:
    """By rig, the best on held-out moves first, the moves that it was asked about and its false alarms.

    A move in doubt costs many times one that fits, and a rig that does not describe the machine doubts every one: a rig is asked
    until its alarms are enough, a later one until it has too many to be handed over in place of an earlier one.
    """
    counts: dict[str, Count] = {}
    apart = max(1, len(parts) // SHOWN)  # those for the record are spread over the logs
    spread = [part for first in range(apart) for part in parts[first::apart]]
    with ThreadPoolExecutor(_TOGETHER) as pool:
        for name, rig in rigs.items():
            least = min((count.false_alarms for count in counts.values()), default=ENOUGH)
            most = ENOUGH if least >= ENOUGH else least - 1
            count = Count(0, 0)
            for first in range(0, len(parts), _TOGETHER):
                if count.moves >= SHOWN and count.false_alarms >= most:
                    break
                asked = spread[first : first + _TOGETHER]
                alarms = pool.map(is_alarm, [part for _, part in asked], [rig(m) for m, _ in asked])
                count = Count(count.moves + len(asked), count.false_alarms + sum(alarms))
            counts[name] = count
    return counts


def _rate(count: Count) -> float:
    return count.false_alarms / max(count.moves, 1)


def handed_over(
    problem: SimulatedMoves, ladder: Ladder[FitResult], given: Rig, extended: Rig, best: str
) -> Rig:
    """The rig that did best on new moves. extended: with everything that was found, a curve included."""
    if best != "refit":
        return given if best == "rig_file" else extended
    fitted = ladder.baseline
    return with_values(
        problem.written, {f.name: fitted.model[f.name] for f in fitted.free}, fitted.std, "improve"
    )


def _part(problem: SimulatedMoves, move: int) -> Log | None:
    """One move with its rests as a log of its own."""
    experiment = problem.experiment
    log = problem.logs[experiment.log[move]]
    begin = int(experiment.start[move] + experiment.moving[move])
    segment = next((s for s in moves_from_rest(log) if s.start == begin), None)
    if segment is None:
        return None
    rate = log.rate_hz
    wide = round(_REST_S * rate)
    whole = slice(max(segment.rest, segment.start - wide), min(segment.end, segment.stop + wide))
    settling = round(settling_time(problem.model) * rate)
    return log.part(as_one_log(whole, segment, log.pitch, settling, round(_SHORTEST_S * rate)))


def as_one_log(rows: slice, segment: Segment, pitch: Array, settling: int, shortest: int) -> slice:
    """Rows that a log of one move would have: at rest when it begins, the rig set up once.

    rows: the move and its rests; settling: samples that a stop and a jump of the pitch (n,) take, shortest: of a rest before a
    move. A log that begins as another move ends has its current in the first state of the integral.
    """
    jumps = np.flatnonzero(np.abs(np.diff(pitch)) > SET_UP_DEG) + 1
    before = jumps[(jumps > segment.rest) & (jumps <= segment.start)]
    stirred = [*([segment.rest] if segment.rest else []), *before.tolist()]
    settled = min(max(stirred) + settling, segment.start - shortest) if stirred else rows.start
    after = jumps[(jumps >= segment.stop) & (jumps < rows.stop)]
    return slice(max(rows.start, settled), int(after[0]) if after.size else rows.stop)


def _without(rig: Rig, fitted: FitResult, move: int) -> Rig:
    """The rig with the constants of a fit that never saw a move."""
    model = without_moves(fitted, [move])
    return with_values(rig, {f.name: model[f.name] for f in fitted.free}, fitted.std, "improve")


def _is_alarm(part: Log, rig: Rig) -> bool:
    """Whether a healthy move is called faulty, or not that of this rig's machine."""
    outcome = diagnose_log(part, rig, Settings())
    events = outcome.isolation.events if outcome.isolation else ()
    return not describes(outcome) or any(event.label != NOMINAL for event in events)
