"""The hypotheses and their filters: one interacting-multiple-model bank, compiled, and its oracle on filterpy."""

from typing import TYPE_CHECKING, Any

from observer_fi.bank import compiled_bank, first_state, log_feed, transition
from observer_fi.bank.bank_state import Memory, memory_of, put, remembered, seats
from observer_fi.bank.compiled_bank import Bank, Feed
from observer_fi.bank.first_state import start
from observer_fi.bank.hypotheses import Hypothesis, arrays, bank
from observer_fi.bank.log_feed import usual_step
from observer_fi.bank.packing import bank_rows, tuning
from observer_fi.bank.work_arrays import scratch

if TYPE_CHECKING:
    from observer_fi.bank.filterpy_bank import FilterpyBank

__all__ = [
    "Bank",
    "Feed",
    "FilterpyBank",
    "Hypothesis",
    "Memory",
    "arrays",
    "bank",
    "bank_rows",
    "compiled_bank",
    "first_state",
    "log_feed",
    "memory_of",
    "put",
    "remembered",
    "scratch",
    "seats",
    "start",
    "transition",
    "tuning",
    "usual_step",
]


def __getattr__(name: str) -> Any:
    if name == "FilterpyBank":  # filterpy is slow to import, and only its own bank needs it
        from observer_fi.bank.filterpy_bank import FilterpyBank

        return FilterpyBank
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
