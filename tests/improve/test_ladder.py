"""The ladder on a problem of five made-up causes, whose gains stand in a table: what is chosen, dropped, swapped, refused."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from observer_fi.improve.improvement import detectable
from observer_fi.improve.ladder import name_causes, next_step, still_standing
from observer_fi.improve.steps import Candidate, HeldOut, Step, Trial
from observer_fi.physics.effects import CAUSES, Variant

Model = frozenset  # of the causes that stand in it
FORM = Variant("plain", ())
NAMES = tuple(list(CAUSES)[:5])
A, B, C, D, E = NAMES


def candidate(name: str, seen: float = 1.0) -> Candidate:
    return Candidate(CAUSES[name], FORM, 0.0, 0.0, {}, {name: seen})


@dataclass
class Table:
    """misfit: of a model that holds these causes [nats]. lies: causes that fit well and fail on held-out samples."""

    misfit: Callable[[Model], float]
    lies: tuple[str, ...] = ()
    rounds: int = 5
    asked: list[Model] = field(default_factory=list)

    def baseline(self) -> Model:
        return Model()

    def screen(self, fitted: Model, steps: Sequence[Step[Model]]) -> list[Candidate]:
        taken = {name for step in steps for name in step.trial.causes}
        return [candidate(name) for name in NAMES if name not in taken]

    def trials(self, fitted: Model, candidates: Sequence[Candidate]) -> list[Trial[Model]]:
        found = []
        for c in candidates:
            after = fitted | {c.cause.name}
            gain = self.misfit(fitted) - self.misfit(after)
            found.append(Trial((c,), after, gain, (gain - 5.0,)))
        return sorted(found, key=lambda t: -t.nets[0])

    def judge(self, fitted: Model, trial: Trial[Model]) -> HeldOut | None:
        self.asked.append(trial.fitted)
        if trial.nets[0] <= 0.0 or set(trial.causes) & set(self.lies):
            return None
        return HeldOut(trial.gain, {})

    def rivals(self, fitted, trial, trials, candidates) -> dict[str, tuple[str, ...]]:
        close = [t.causes[0] for t in trials if t is not trial and trial.gain - t.gain < 3.0]
        return {trial.causes[0]: tuple(close)}

    def settled(self, fitted: Model, trial: Trial[Model]) -> Model:
        return fitted | set(trial.causes)

    def without(self, fitted: Model, candidates: Sequence[Candidate]) -> Model:
        return fitted - {c.cause.name for c in candidates}


def independent(gains: dict[str, float]) -> Callable[[Model], float]:
    return lambda model: 1000.0 - sum(gains.get(name, 0.0) for name in model)


def names(steps: Sequence[Step[Model]]) -> list[str]:
    return [name for step in steps for name in step.trial.causes]


def test_the_largest_gain_is_named_first_and_what_does_not_pay_is_refused():
    ladder = name_causes(Table(independent({A: 50.0, B: 200.0, C: 4.0})))
    assert names(ladder.steps) == [B, A]
    assert ladder.extended == {A, B} and ladder.path == ({B}, {A, B})
    assert dict(ladder.refused) == {C: -1.0, D: -5.0, E: -5.0}
    assert [c.cause.name for c in ladder.screened] == [C, D, E]


def test_a_cause_that_fails_on_held_out_samples_is_passed_over_for_the_next():
    ladder = name_causes(Table(independent({A: 50.0, B: 200.0}), lies=(B,)))
    assert names(ladder.steps) == [A]
    assert dict(ladder.refused)[B] == 195.0


def test_nothing_is_named_where_nothing_pays():
    ladder = name_causes(Table(independent({A: 4.9})))
    assert ladder.steps == () and ladder.extended == ladder.baseline == frozenset()


def test_rivals_are_told_with_the_cause():
    step, _, _ = next_step(Table(independent({A: 50.0, B: 48.0, C: 40.0})), Model(), [])
    assert step is not None and step.rivals == {A: (B,)}


def test_the_ladder_ends_after_its_rounds():
    assert len(name_causes(Table(independent(dict.fromkeys(NAMES, 50.0)), rounds=2)).steps) == 2


def stand_in(model: Model) -> float:
    """B and C together do all that A did when it was named first, and more."""
    if {B, C} <= model:
        return 100.0
    return 1000.0 - 300.0 * (A in model) - 200.0 * (B in model) - 180.0 * (C in model)


def test_a_cause_is_dropped_when_others_have_taken_its_place():
    ladder = name_causes(Table(stand_in))
    assert list(dict.fromkeys(names(ladder.steps))) == [B, C]
    assert ladder.extended == {B, C}
    assert ladder.path[0] == {A}  # it was named first


def swapped(model: Model) -> float:
    """A looks best alone; beside B the cause is C, which needs B to be seen."""
    gain = 300.0 * (A in model) + 100.0 * (B in model)
    if {B, C} <= model and A not in model:
        gain += 350.0
    return 1000.0 - gain


def test_a_cause_is_swapped_for_one_that_explains_more_beside_the_others():
    ladder = name_causes(Table(swapped))
    assert sorted(names(ladder.steps)) == sorted([B, C])
    assert ladder.extended == {B, C}


def test_what_stands_keeps_the_fit_and_gets_its_gain_beside_the_others():
    table = Table(independent({A: 50.0, B: 200.0}))
    ladder = name_causes(table)
    fitted, steps = still_standing(table, ladder.extended, ladder.steps)
    assert fitted is ladder.extended
    assert [step.trial.gain for step in steps] == [200.0, 50.0]


def test_a_single_step_is_not_asked_again():
    table = Table(independent({A: 50.0}))
    assert still_standing(table, Model({A}), name_causes(table).steps)[0] == {A}
    assert table.asked.count(Model({A})) == 1


def test_detectable_sizes_are_those_of_the_best_form_and_of_aliases():
    scores = [candidate("torque_offset", 2.0), candidate("torque_offset", 9.0)]
    scores += [candidate("backlash", float("inf"))]
    found = detectable(scores)
    assert found["torque_offset"] == found["pitch_offset"] == {"torque_offset": 2.0}
    assert found["backlash"] is None and found["brush_drop"] is None
