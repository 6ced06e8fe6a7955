"""Verdicts in words that a technician can act on."""

from observer_fi.physics import Rig
from observer_fi.records import Event, Isolation, Log
from observer_fi.verdict.testable import NOT_TESTED

_WHAT = {
    "nominal": "The actuator behaved as its model says.",
    "overload": "The mass pressed against an obstacle or a travel limit: current rose while the mass moved at "
    "about half its speed.",
    "coupling_loss": "The motor turned without moving the mass: the coupling between lead screw and nut has let go.",
    "sensor_fault": "The {channel} sensor stopped telling the truth, while the other channels agree with the model.",
    "unknown": "Something went wrong that is none of the known faults.",
}
_ACT = {
    "nominal": "No action is needed.",
    "overload": "Stop the move, look for an obstacle and compare the position with the travel limits before moving again.",
    "coupling_loss": "Do not command further moves; check the setscrew between lead screw and nut.",
    "sensor_fault": "Check the {channel} sensor, its wiring and its input channel before trusting further moves.",
    "unknown": "Inspect the drive by hand, and compare friction, supply and winding resistance with an earlier healthy move.",
}
_ALIKE = {
    (
        "sensor_fault",
        "voltage",
    ): "A changed winding resistance looks the same as a voltage sensor fault in these channels: "
    "measure the resistance at rest to tell them apart.",
    (
        "sensor_fault",
        "position",
    ): "A nut that slips or a lost coupling can look like a dead position sensor while the speed is steady: "
    "a reversal, or the encoder, tells them apart.",
    ("unknown", None): "A wrong pitch reading looks the same as a changed load.",
}


def explanation(isolation: Isolation, rig: Rig, log: Log) -> str:
    """One paragraph: what happened, when, how sure, what it could be instead, what to do."""
    v = isolation.verdict
    if v.label == NOT_TESTED:
        return f"Not tested: {v.reasons[0]}, so it says nothing about the actuator."
    words = [_WHAT[v.label].format(channel=v.channel)]
    if v.label != "nominal":
        words.append(_when(v))
    words.append(f"The probability of this verdict is {_percent(v.probability)}.")
    words += [f"Note: {reason}." for reason in v.reasons]
    alike = _ALIKE.get((v.label, v.channel))
    if alike:
        words.append(alike)
    if v.label == "coupling_loss":
        words += _blind_spot(rig)
    later = [e for e in isolation.events if e.label not in ("nominal", v.label)]
    if later:
        words.append(
            f"Other moves of this log show {', '.join(sorted({e.label.replace('_', ' ') for e in later}))}."
        )
    if _chronic(isolation):
        words.append(
            "Most moves of this log disagree with the rig file in the same way, which points at the model rather than at a "
            "fault: run `observer-fi improve` on it, and diagnose again with the rig it writes."
        )
    words.append(_ACT[v.label].format(channel=v.channel))
    return " ".join(words)


def _chronic(isolation: Isolation) -> bool:
    """Whether at least three moves, and half of them, are explained by no named fault."""
    odd = sum(e.label in ("unknown", "sensor_fault") for e in isolation.events)
    return odd >= 3 and 2 * odd >= len(isolation.events)


def _when(v: Event) -> str:
    if v.onset_s is None:
        return "Its beginning cannot be placed within the move."
    low, high = v.onset_interval_s
    text = f"It began at {v.onset_s:.3f} s"
    if low is not None and high is not None and high > low:
        text += f" (95 % between {low:.3f} and {high:.3f} s)"
    if v.isolated_s is not None:
        text += f" and was certain from {v.isolated_s:.3f} s on"
    return text + "."


def _percent(p: float) -> str:
    return "above 99.9 %" if p > 0.999 else f"{100.0 * p:.1f} %"


def _blind_spot(rig: Rig) -> list[str]:
    """Where decoupled and nominal draw the same current (design section 2): theta = (A' - A) / B."""
    model = rig.model
    if not model["B"]:
        return []
    angle = (model["A_decoupled"] - model["A"]) / model["B"]
    return [
        f"Near {angle:.1f} deg of pitch (forward moves) a lost coupling draws the nominal current, "
        "and only a start or a reversal tells."
    ]
