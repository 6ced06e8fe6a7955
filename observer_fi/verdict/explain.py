"""Verdicts in words that a technician can act on."""

from observer_fi.physics import FAULTS, NOMINAL, NOT_TESTED, Rig
from observer_fi.records import Event, Isolation, Log


def explanation(isolation: Isolation, rig: Rig, log: Log) -> str:
    """One paragraph: what happened, when, how sure, what it could be instead, what to do."""
    v = isolation.verdict
    if v.label == NOT_TESTED:
        return f"Not tested: {v.reasons[0]}, so it says nothing about the actuator."
    row = FAULTS[v.label]
    others = " or ".join(FAULTS[label].title.lower() for label in v.alike)
    doubted = v.label == NOMINAL and bool(v.alike)
    words = [row.says(row.happened, v.channel)]
    if doubted:
        words = [f"The actuator behaved as its model says but for what may be a fault: {others}."]
    if v.label != NOMINAL:
        words.append(_when(v))
    if v.severity:
        words.append(_sentence(", ".join(s.words for s in v.severity)))
    words += [_sentence(text) for text in second_faults(isolation)]
    if v.alike and not doubted:
        words.append(f"These data cannot tell it from: {others}.")
    words.append(f"The probability of this verdict is {_percent(v.probability)}.")
    words += [f"Note: {reason}." for reason in v.reasons]
    words += [text for text in (row.alike.get(v.channel, ""), row.caveat(rig.model)) if text]
    later = [e for e in isolation.events if e.label not in (NOMINAL, v.label)]
    if later:
        words.append(
            f"Other moves of this log show {', '.join(sorted({FAULTS[e.label].title.lower() for e in later}))}."
        )
    if _chronic(isolation):
        words.append(
            "Most moves of this log disagree with the rig file in the same way, which points at the model rather than at a "
            "fault: run `observer-fi improve` on it, and diagnose again with the rig it writes."
        )
    if doubted and isolation.could_show is not None and set(v.alike) <= set(isolation.could_show.blind):
        words.append(
            "Have the missing channel read again and repeat the move: this one is no all-clear for it."
        )
    elif doubted:
        words.append(
            "Look at the next moves: what is a fault comes again or grows, what a day brings passes."
        )
    else:
        words.append(row.says(row.action, v.channel))
    return " ".join(words)


def second_faults(isolation: Isolation) -> tuple[str, ...]:
    """A sentence for each fault that came behind another one in its move."""
    return tuple(_second(event, later) for event in isolation.events for later in event.then)


def _second(first: Event, later: Event) -> str:
    was = FAULTS[first.label].title.lower()
    text = f"behind the {was} of {first.onset_s:.3f} s the same move shows a second fault from {later.onset_s:.3f} s on: "
    text += FAULTS[later.label].title.lower()
    if later.over_s is not None:
        text += f", over at {later.over_s:.3f} s"
    sizes = ", ".join(s.words for s in later.severity)
    return f"{text} ({sizes})" if sizes else text


def _chronic(isolation: Isolation) -> bool:
    """Whether at least three moves, and half of them, are explained by no named fault."""
    odd = sum(FAULTS[e.label].rare for e in isolation.events)
    return odd >= 3 and 2 * odd >= len(isolation.events)


def _when(v: Event) -> str:
    if v.onset_s is None:
        return "Its beginning cannot be placed within the move."
    low, high = v.onset_interval_s
    text = f"It began at {v.onset_s:.3f} s"
    if low is not None and high is not None and high > low:
        told = f"{low:.3f}", f"{high:.3f}"
        text += (
            " (to the millisecond)" if told[0] == told[1] else f" (95 % between {told[0]} and {told[1]} s)"
        )
    if v.isolated_s is not None:
        text += f" and was certain from {v.isolated_s:.3f} s on"
    if v.over_s is not None:
        text += f"; it was over at {v.over_s:.3f} s"
    return text + "."


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _percent(p: float) -> str:
    return "above 99.9 %" if p > 0.999 else f"{100.0 * p:.1f} %"
