"""The hypotheses and their filters: one interacting-multiple-model bank, compiled, and its oracle on filterpy."""

from typing import TYPE_CHECKING, Any

from observer_fi.bank import compiled_bank, first_state, log_feed, transition
from observer_fi.bank.bank_state import (
    BankState,
    HypothesisState,
    Visits,
    bank_state_of,
    entries,
    state_of,
    state_places,
    states_of,
    visits_of,
    write_state,
)
from observer_fi.bank.compiled_bank import Bank, LogSamples
from observer_fi.bank.first_state import start
from observer_fi.bank.hypotheses import (
    Hypothesis,
    arrays,
    bank,
    of_a_move,
    on_top,
    other_laws,
    repeat_share,
)
from observer_fi.bank.log_feed import usual_step
from observer_fi.bank.packing import bank_rows, tuning
from observer_fi.bank.rig_scale import ROOMS, between_samples, usual_errors, with_room, with_servo_error
from observer_fi.bank.work_arrays import work_arrays

if TYPE_CHECKING:
    from observer_fi.bank.filterpy_bank import FilterpyBank

__all__ = [
    "ROOMS",
    "Bank",
    "BankState",
    "LogSamples",
    "FilterpyBank",
    "Hypothesis",
    "HypothesisState",
    "arrays",
    "bank",
    "bank_rows",
    "between_samples",
    "compiled_bank",
    "first_state",
    "log_feed",
    "of_a_move",
    "on_top",
    "other_laws",
    "repeat_share",
    "entries",
    "Visits",
    "state_of",
    "states_of",
    "visits_of",
    "write_state",
    "bank_state_of",
    "work_arrays",
    "state_places",
    "start",
    "transition",
    "tuning",
    "usual_errors",
    "usual_step",
    "with_room",
    "with_servo_error",
]


def __getattr__(name: str) -> Any:
    if name == "FilterpyBank":  # filterpy is slow to import, and only its own bank needs it
        from observer_fi.bank.filterpy_bank import FilterpyBank

        return FilterpyBank
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
