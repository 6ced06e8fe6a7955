"""What paths of a whole move may be called: which of them count and fit, the stories they tell, and the event with the best.

`stories.py` has what a name is worth; here stands what it takes to be one at all on this rig.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from observer_fi.logs import turns_round
from observer_fi.numerics import digits
from observer_fi.physics import (
    COLUMNS,
    FAULTS,
    NOMINAL,
    PARAMETERS,
    UNKNOWN,
    OwnState,
    Rig,
    channel_of,
    label_of,
)
from observer_fi.records import Event, Severity
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import COMES_AND_GOES
from observer_fi.verdict.drive_off import goes_off
from observer_fi.verdict.isolate import AT_START_S
from observer_fi.verdict.moves.stories import (
    AT_WILL,
    Story,
    constant,
    follows_whole,
    load_of_a_spring,
    measured,
    of_any_decade,
    posterior_of,
    special_case,
    takes_up_any_load,
)
from observer_fi.verdict.moves.whole_move import (
    FITS,
    HOPELESS,
    JUMP_DEG,
    SETTLED_S,
    STOPPED_S,
    STRIDE,
    WELL,
    Path,
    WholeMove,
)

PASSES_S = 0.03  # what is over so soon passed, and condemns no move
CLEAN_S = 0.05  # of motion that nominal must have explained before a fault
FAR = 200.0  # times the nats of another fault, that one must have for which no motion speaks before it
FOLLOWED = 4.0  # standard deviations from all of its travel that a mass still follows in part
BELIEVABLE = 3.0  # standard deviations by which a constant may be beyond what is believable
Z95 = 1.959964
NEARLY = 0.99  # of what a load at will explains
# What begins within this of the stop gains by a speed in doubt anew: 39 nats in healthy moves at 10 rad/s, 53 with gains that
# are off. It must have so many times the nats of another fault.
STOPPING_S, IN_A_STOP = 0.01, 10.0
JUMPING_S = (
    0.05  # about a jump of the pitch between two samples: when between them the load came, nobody knows
)
NONE_AT_ZERO = {"torque", "rate", "C", "E"}  # sizes that a fault without any has
ALL_OF_IT = {"A_decoupled": "A", "J_decoupled": "J"}  # of what a motor has without its mass, what with it
ELECTRICAL, AS_MUCH = {"voltage", "current"}, 0.8  # of what the failure of one explains, that of the other
BLIND = 1e-3  # probability from which a lost coupling is as good as a frozen position


class Naming:
    """Judges paths of whole moves on one rig."""

    def __init__(self, rig: Rig, settings: DecisionSettings) -> None:
        self.rig, self.settings = rig, settings

    def told_by(self, paths: Sequence[Path], whole: WholeMove, event: Event) -> list[Story]:
        """What paths may be called, where the best of all is one that fits: what is worse has no say, whatever it is called.

        A load and a slip at will fit everything: no verdict that the bank is sure of gives way to them, nor does any name where
        even they do not fit.
        """
        sure = event.label not in (NOMINAL, UNKNOWN)
        paths = _as_far_as_it_fits(paths if sure else self._seen_to_begin(paths, whole, event), whole)
        if not paths or not any(self._fits(path, whole, event) for path in _as_good(paths)):
            return []
        if sure and paths[0].hypothesis.label == UNKNOWN:
            return []
        told = [p for p in paths if not (sure and p.hypothesis.label == UNKNOWN)]
        swings = self._swings(paths, whole)
        told = [p for p in told if not (swings and p.hypothesis.label == "jam")]
        stories = [story for p in told if self._fits(p, whole, event) for story in self.stories(p, whole)]
        return _named_first([story for story in stories if measured(story, whole)], whole)

    def told(self, event: Event, stories: Sequence[Story], whole: WholeMove) -> Event:
        """The event with the label, times and severity of the best story."""
        best, t = stories[0], whole.window.t
        path, label = best.path, label_of(best.mode)
        posterior = posterior_of(event, stories)
        if best.mode == "slip" and _gives_way(path, whole):
            posterior = dict.fromkeys(posterior, 0.0) | dict.fromkeys(("slip", "overload"), 0.5)
        sizes = path.hypothesis.own if path.hypothesis.label == label else FAULTS[label].sizes
        tells = [own for own in sizes if own.tells and own.name in path.hypothesis.states]
        told = event._replace(
            label=label, channel=channel_of(best.mode), probability=posterior[label], posterior=posterior,
            over_s=None if path.end is None or whole.lasts(path) else float(t[path.end]),
            alike=tuple(k for k, p in posterior.items() if k != label and p > self._least({label, k}, best.mode, event)),
            severity=tuple(self._severity(path, own, whole) for own in tells),
        )  # fmt: skip
        begin, first = float(t[max(path.begin - 1, 0)]), float(t[max(path.first - 1, 0)])
        if begin - event.start_s < AT_START_S:  # no motion before it: it may be as old as the rest
            moved = np.flatnonzero((t < event.start_s) & (whole.window.w_cmd != 0.0))
            first = float(t[moved[-1] if moved.size else 0])
        told = told._replace(onset_s=begin, onset_interval_s=(first, float(t[path.last])))
        if label == event.label and label != UNKNOWN:
            as_before = told._replace(probability=event.probability, posterior=event.posterior)
            return _or_the_other_sensor(told if told.alike else as_before, stories)
        told = told._replace(
            isolated_s=None, detected_s=event.detected_s or event.doubted_s,
            reasons=(_why(best, whole),) if label != UNKNOWN else event.reasons,
        )  # fmt: skip
        return _or_the_other_sensor(told, stories)

    def counts(self, path: Path, whole: WholeMove, event: Event) -> bool:
        """Whether the path is better than nominal by more than chance, and more than the ring of a start.

        Whatever is entered there begins anew with a speed in doubt, and gains by that: a fault goes on to gain, and a size
        that stands shows; and in a stop, also where the motion before it says next to nothing.
        """
        if (
            _passes(path, whole, event.start_s)
            or _tells_afterwards(path, whole)
            or self._goes_off(path, whole)
        ):
            return False
        if _in_doubt(path, whole) or (whole.n > whole.moving and path.moving < self.settings.move_nats):
            more = max(shown(path), path.later)
            return min(path.gain, more) >= IN_A_STOP * self.settings.move_nats
        rings = whole.window.t[path.begin] < event.start_s + SETTLED_S or _behind_a_turn(path, whole)
        stands = all(own.growth == 0.0 for own in path.hypothesis.own)
        more = min(path.later, shown(path) if stands else math.inf) if rings else math.inf
        return min(path.gain, more) >= self.settings.move_nats

    def _goes_off(self, path: Path, whole: WholeMove) -> bool:
        """Whether a path begins where the drive may have been switched off at rest."""
        electrical, noise = whole.window.z[:, :2], self.rig.noise_std[:2]
        at_rest = path.begin >= whole.moving
        return at_rest and goes_off(electrical, noise, path.begin, whole.interval, whole.zero)

    def _fits(self, path: Path, whole: WholeMove, event: Event) -> bool:
        """Whether the path wins, the whole move fits it, and it is more than the ring of a start.

        Another name than the bank's needs motion before the fault that nominal explains.
        """
        if not self.counts(path, whole, event):
            return False
        if path.nis > FITS * whole.expected(path.hypothesis) or whole.reads_as_usual(path):
            return False
        return path.hypothesis.label == event.label or self._clean(path, whole, event.start_s)

    @staticmethod
    def _swings(paths: Sequence[Path], whole: WholeMove) -> bool:
        """Whether the best jam drives the motion for a while: then none of them is one, whatever friction they began with."""
        best = next((p for p in paths if p.hypothesis.label == "jam"), None)
        return best is not None and any(
            whole.turns(best, own) for own in best.hypothesis.own if own.of_friction
        )

    def _seen_to_begin(self, paths: Sequence[Path], whole: WholeMove, event: Event) -> Sequence[Path]:
        """The paths without those from the start on where one that begins in motion says as much: what grows was first less.

        From the start on a fault and a rig file that is off look alike.
        """
        seen = [p for p in paths if whole.window.t[p.begin] - event.start_s >= CLEAN_S]
        if not seen or seen[0] is paths[0] or self._fits(paths[0], whole, event):
            return paths
        return seen if seen[0].gain >= HOPELESS * paths[0].gain else paths

    def stories(self, path: Path, whole: WholeMove) -> Iterator[Story]:
        """What a path may be called: the fault that it was made for, or one that is a special case of it.

        A soft stop without stiffness is a slip; a mass that has lost all its travel without any change of the load is a position
        that stands still, and one that outruns the motor a position that is wrong. The evidence of a special case is the
        posterior density of its constant over the prior one (Dickey 1971). A mass that stands while the load grows is none of
        these, nor is one that an obstacle draws on.
        """
        mode, held = path.hypothesis.name, {own.name: own for own in path.hypothesis.own}
        if _stands_under_load(path) or draws_on(path, whole) or self._load_in_a_stop(path, whole):
            return
        if all(self._believable(path, own, whole) for own in held.values()) and _resists(path):
            yield Story(mode, path.gain + self._as_in_the_file(path), path)
        if "E" not in held:
            return
        lost, std = constant(path, held["E"])
        if "C" in held and "torque" not in held and self._believable(path, held["E"], whole):
            yield Story("slip", path.gain + special_case(path, held["C"], 0.0), path)
        if abs(lost - 1.0) < BELIEVABLE * std and not _gives_way(path, whole):
            yield Story("sensor:position", path.gain + special_case(path, held["E"], 1.0), path)
        elif lost < -BELIEVABLE * std and not _presses(path):
            yield Story("sensor:position", path.gain, path)

    @staticmethod
    def _load_in_a_stop(path: Path, whole: WholeMove) -> bool:
        """Whether an obstacle with a load in front of it begins as the motor stops: it follows whatever a stop does."""
        begins = path.begin >= whole.moving - round(STOPPED_S / whole.interval)
        return begins and path.hypothesis.label != UNKNOWN and takes_up_any_load(path)

    def _as_in_the_file(self, path: Path) -> float:
        """Nats by which the sizes that the rig file gives explain the move better, half of all faults having them."""
        usual = {own.name: self.rig.spread(own.name) for own in FAULTS[path.hypothesis.label].states}
        nats = any_size = 0.0
        for own in path.hypothesis.own:
            value, std = constant(path, own)
            any_size += of_any_decade(path, own)
            if own.name not in usual or own.std is None or not usual[own.name]:
                continue
            given = self.rig.model[own.name] if own.absolute else 1.0
            near = math.hypot(std, usual[own.name] * given)
            wide = math.hypot(std, own.std)
            nats += (
                0.5 * ((value - own.mean) / wide) ** 2
                - 0.5 * ((value - given) / near) ** 2
                + math.log(wide / near)
            )
        return float(np.logaddexp(nats, any_size)) - math.log(2.0)

    @staticmethod
    def _believable(path: Path, own: OwnState, whole: WholeMove) -> bool:
        value, std = constant(path, own)
        value *= whole.against(path) if own.of_friction else 1.0
        if path.hypothesis.label == "jam" and own.of_friction and value <= 0.0:
            return False
        high, model = own.high, path.hypothesis.model
        if (
            own.name in ALL_OF_IT and model[own.name]
        ):  # the rig file's share is a guess: no more than all is left
            high = max(high, model[ALL_OF_IT[own.name]] / model[own.name])
        if own.name == "A_decoupled":  # a share of the friction that the rig has on that day
            value /= max(whole.friction(path.begin), 1.0)
        return own.low - BELIEVABLE * std <= value <= high + BELIEVABLE * std

    def _clean(self, path: Path, whole: WholeMove, start_s: float) -> bool:
        """Whether nominal explains the motion before the fault, and there was some; or there was none, and only the fault fits.

        A fault that is there from the start must win by far: a rig file that is off also shows from the start.
        """
        first = int(np.searchsorted(whole.window.t, start_s))
        if path.begin == 0 and start_s < whole.window.t[0]:
            return False  # it may have been there before, where nobody knows
        if whole.window.t[path.begin] - start_s < CLEAN_S:
            fits = path.nis <= WELL * whole.expected(path.hypothesis) and not self._is_of_the_rig(path, whole)
            return fits and whole.lasts(path) and path.later >= FAR * self.settings.move_nats
        settled = int(np.searchsorted(whole.window.t, start_s + SETTLED_S))
        first = (
            settled if path.begin - settled >= round(CLEAN_S / whole.interval) else first
        )  # how a motor starts is told less well
        return float(whole.nis[first : path.begin].mean()) <= FITS * whole.expected(whole.nominal)

    def _is_of_the_rig(self, path: Path, whole: WholeMove) -> bool:
        """Whether a friction that was up from the start on is one that this rig may have, as far as it is known by then."""
        rises = [own for own in path.hypothesis.own if own.of_friction]
        if path.hypothesis.label != "jam" or not rises:
            return False
        friction = (self._friction(path)[0] + constant(path, rises[0])[0]) / self.rig.model["A"]
        usual, doubt = whole.drag(path.begin)
        return friction - usual < max(self.settings.strain_limit * doubt, COMES_AND_GOES)

    def _least(self, labels: set[str], mode: str, event: Event) -> float:
        """Probability from which one label is as good as another: of a lost coupling and a frozen position a small one.

        Only what the motor feels without the mass tells those two apart, and that may be what it felt with it. Where the bank
        is sure of the other, as many nats decide as speak against health.
        """
        blind = labels == {"coupling_loss", "sensor_fault"} and channel_of(mode) in (None, "position")
        if not blind:
            return self.settings.alike
        against = event.label in labels and event.label != label_of(mode)
        return min(math.exp(-self.settings.move_nats) if against else BLIND, self.settings.alike)

    def _severity(self, path: Path, own: OwnState, whole: WholeMove) -> Severity:
        value, std = constant(path, next(state for state in path.hypothesis.own if state.name == own.name))
        scale, unit = 1.0, "1"
        if own.of_friction:
            friction, doubt = self._friction(path)
            scale = whole.against(path) / friction
            std = math.hypot(std, value * doubt)
        elif own.told_as is not None:
            scale, unit = own.told_as.value(path.hypothesis.model), own.told_as.unit
        elif not own.absolute:
            scale, unit = self.rig.model[own.name], PARAMETERS[own.name][0]
        said = (scale * value, unit)
        if own.told_as is not None:
            said = (value * own.told_as.in_words(path.hypothesis.model), own.told_as.unit_in_words)
        value, half = scale * value, Z95 * abs(scale) * std
        return Severity(own.tells, value, (value - half, value + half), unit, own.says(*said))

    def _friction(self, path: Path) -> tuple[float, float]:
        """Friction of the healthy rig as the move has it [N m], and the relative standard deviation of that."""
        usual, states = self.rig.model["A"], path.hypothesis.states
        if "A" not in states:
            return usual, self.rig.spread("A")
        k = states.index("A")
        factor = float(path.memory.x[k])
        return usual * factor, math.sqrt(max(float(path.memory.P[k, k]), 0.0)) / factor


def _tells_afterwards(path: Path, whole: WholeMove) -> bool:
    """Whether all that a fault of an instant gains comes when it has long been over: of a state that was in doubt anew."""
    soon = path.end is not None and path.end - path.begin < round(SETTLED_S / whole.interval)
    return soon and path.gain < path.later


def _as_good(paths: Sequence[Path]) -> list[Path]:
    """The best path and those of its label that begin at another sample and gain next to as much."""
    best = paths[0]
    return [
        p
        for p in paths
        if p.hypothesis.label == best.hypothesis.label and p.gain >= (1.0 - AT_WILL) * best.gain
    ]


def _in_doubt(path: Path, whole: WholeMove) -> bool:
    """Whether a path begins where a filter that begins anew gains: as the motor stops, or as its load jumps between samples."""
    if whole.n > whole.moving and path.begin >= whole.moving - round(STOPPING_S / whole.interval):
        return True
    near = round(JUMPING_S / whole.interval)
    pitch = whole.window.theta[max(path.begin - near, 0) : path.begin + near]
    return bool((np.abs(np.diff(pitch)) > JUMP_DEG).any())


def _behind_a_turn(path: Path, whole: WholeMove) -> bool:
    """Whether a path begins in the ring of a reversal without a rest, in which a motor starts anew."""
    before = whole.window.w_cmd[max(path.begin - round(SETTLED_S / whole.interval), 0) : path.begin + 1]
    return turns_round(before, whole.window.w_cmd)


def shown(path: Path) -> float:
    """Most nats by which the sizes that a path found are not none: of its gain, what is not of having begun anew.

    In a start or a stop a mass sticks sooner or later than nominal foresees, and every fault that is entered there gains
    alike. Of a lost coupling no size is none.
    """
    sizes = [constant(path, own) for own in path.hypothesis.own if own.name in NONE_AT_ZERO]
    return sum(0.5 * (value / std) ** 2 for value, std in sizes if std) if sizes else math.inf


def _resists(path: Path) -> bool:
    """Whether a spring has shown its stiffness: one of none is a slip, and a load before it that the mass follows a jam.

    Where the mass loses travel by it, a load will do.
    """
    own = {o.name: o for o in path.hypothesis.own}
    if "C" not in own or own["C"].told_as is None:
        return True
    value, std = constant(path, own["C"])
    if "torque" in own and not follows_whole(path):
        value, std = load_of_a_spring(path)
    return value > BELIEVABLE * std


def _presses(path: Path) -> bool:
    """Whether a path needs the load of an obstacle, of which a position that is wrong brings none."""
    own = {o.name: o for o in path.hypothesis.own}
    if "C" not in own:
        return False
    value, std = load_of_a_spring(path) if "torque" in own else constant(path, own["C"])
    return value > BELIEVABLE * std


def draws_on(path: Path, whole: WholeMove) -> bool:
    """Whether a path takes a load that fell for an obstacle that draws the mass on: none does."""
    if not {"C", "d"} <= {o.name for o in path.hypothesis.own}:
        return False
    k = path.hypothesis.states.index("d")
    depth = whole.direction(path.begin, path.end) * float(path.memory.x[k])
    return depth < -BELIEVABLE * math.sqrt(max(float(path.memory.P[k, k]), 0.0))


def _stands_under_load(path: Path) -> bool:
    """Whether a path takes a mass that has lost all its travel for one that presses against something."""
    own = {o.name: o for o in path.hypothesis.own}
    if not {"C", "E"} <= own.keys():
        return False
    (lost, std), (stiff, doubt) = constant(path, own["E"]), constant(path, own["C"])
    return lost > 1.0 - BELIEVABLE * std and stiff > BELIEVABLE * doubt


def _as_far_as_it_fits(paths: Sequence[Path], whole: WholeMove) -> Sequence[Path]:
    """The paths without those of a load at will where that does not fit and a fault with a name explains as good as all of it."""
    named = [path for path in paths if path.hypothesis.label != UNKNOWN]
    if not named or named[0] is paths[0] or paths[0].nis <= FITS * whole.expected(paths[0].hypothesis):
        return paths
    return named if named[0].gain >= NEARLY * paths[0].gain else paths


def _named_first(stories: list[Story], whole: WholeMove) -> list[Story]:
    """Stories without those of a load at will where a name explains as good as all of what they do, and fits well.

    How a mass meets an obstacle no law says to the last nat.
    """
    most = max((story.gain for story in stories), default=0.0)
    named = [story for story in stories if story.mode != UNKNOWN]
    well = any(s.gain >= NEARLY * most and s.path.nis <= whole.expected(s.path.hypothesis) for s in named)
    return named if well else stories


def _passes(path: Path, whole: WholeMove, start_s: float) -> bool:
    """Whether the path is over before the ring of a start is, or as soon as it has begun."""
    if path.end is None:
        return False
    begin, end = whole.window.t[path.begin], whole.window.t[path.end]
    return bool(end < start_s + SETTLED_S or end - begin < PASSES_S)


def _gives_way(path: Path, whole: WholeMove) -> bool:
    """Whether a mass that in the end has lost all its travel followed in part before, as no reading that stands does.

    A nut that slips ever more does so, and a soft stop behind which the coupling lets go.
    """
    own = next((own for own in path.hypothesis.own if own.name == "E"), None)
    if own is None or abs(constant(path, own)[0] - 1.0) > BELIEVABLE * constant(path, own)[1]:
        return False
    h, last = path.hypothesis, whole.n if path.end is None else path.end
    memories, _ = whole.followed(h, whole.entered(path), path.begin)
    look = max(whole.looks[1] // STRIDE, 1)  # until it has found the share, and over which a chance ends
    seen = [constant(path._replace(memory=m), own) for m in memories[look : (last - path.begin) // STRIDE]]
    off = np.array([(1.0 - share) / std for share, std in seen if std > 0.0])
    return off.size >= look and float(np.convolve(off, np.ones(look) / look, "valid").max()) > FOLLOWED


def _or_the_other_sensor(told: Event, stories: Sequence[Story]) -> Event:
    """The event, in doubt about its channel where voltage and current contradict each other and either may be the wrong one.

    How a sensor fails is no part of its model: a small drift costs the true one as much as friction that comes and goes costs
    the other.
    """
    gains = {channel_of(story.mode): story.gain for story in reversed(stories)}
    if told.channel not in ELECTRICAL:
        return told
    (other,) = ELECTRICAL - {told.channel}
    if gains.get(other, -math.inf) < AS_MUCH * gains[told.channel]:
        return told
    why = f"{COLUMNS[told.channel]} and {COLUMNS[other]} contradict each other, and either may be the one that is wrong"
    return told._replace(
        probability=min(told.probability, 0.5), isolated_s=None, reasons=(*told.reasons, why)
    )


def _why(best: Story, whole: WholeMove) -> str:
    while_it = "" if whole.lasts(best.path) else " for a while"
    powers = digits(best.gain / math.log(10.0))
    return f"the whole move says so: with this fault{while_it} it is likelier by {powers} powers of ten than without"
