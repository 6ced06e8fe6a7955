"""What `plan` found, for people: what to record, whether it decides, and the command over time, beside simpler moves."""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.numerics import digits, readable, with_unit
from observer_fi.physics import PARAMETERS
from observer_fi.plan import DECISIVE, Plan, Profile, Rival, course, moves_csv, steps, to_json, total_seconds
from observer_fi.report.diagnosis import environment, json_text, versions
from observer_fi.report.interactive import INK, MUTED, TIME, Charts, Mark, Panel, Series

SURE, OPEN = "#2f7d4f", "#b4560f"  # decided, and not
COMMAND, TRAVEL, PITCH = "#0b62b0", "#7a3b9a", "#8a6100"
_MILLION = math.log(1e6)
_EVEN = 0.05  # nats: odds of 1.05


def plan_files(plan: Plan) -> dict[str, str]:
    """Everything that one plan consists of, {file name: text}."""
    return {"moves.csv": moves_csv(plan), "plan.json": json_text(to_json(plan)), "plan.html": page(plan)}


def page(plan: Plan) -> str:
    """plan.html: one file, no network, the same bytes for the same plan."""
    profiles = [
        ("These moves", plan.planned),
        ("Simpler ones", plan.simpler),
        ("There and back at top speed", plan.before),
    ]
    return str(
        environment()
        .get_template("plan.html")
        .render(
            plan=plan, headline=headline(plan), colour=SURE if plan.decides else OPEN, named=_named(plan), odds=odds,
            needed=DECISIVE, planned=steps(plan.planned, plan.limits), simpler=steps(plan.simpler, plan.limits),
            profiles=[(name, p, _seconds(p, plan)) for name, p in _different(profiles)], limits=_limits(plan),
            sizes=[(_plain(r.name), _sizes(r)) for r in plan.rivals], constants=_constants(plan), plain=_plain,
            charts=charts(plan), versions=versions(),
        )
    )  # fmt: skip


def headline(plan: Plan) -> str:
    """What the moves decide, in one line."""
    if plan.std:
        return f"These moves {'pin down' if plan.decides else 'do not pin down'} {' and '.join(plan.std)}"
    if not plan.planned.blocks:
        return f"No move tells {' from '.join(_named(plan))}"
    if len(plan.rivals) == 1 or plan.rivals[-1].within_all:
        return f"These moves {'show' if plan.decides else 'may not show'} {_named(plan)[0]}"
    return f"These moves {'tell' if plan.decides else 'may not tell'} {' from '.join(_named(plan))}"


def odds(nats: float) -> str:
    """Odds in words, which past a million say no more."""
    if nats > _MILLION:
        return "over a million to 1"
    return "even" if nats < _EVEN else f"{digits(math.exp(nats), 2)} to 1"


def _named(plan: Plan) -> list[str]:
    return [_plain(rival.name) for rival in plan.rivals]


def _plain(name: str) -> str:
    """The name of a cause, fault or parameter in words."""
    label, _, channel = name.partition(":")
    if channel:
        return f"a frozen {channel} sensor"
    return "no cause" if label == "none" else label.replace("_", " ")


def _different(profiles: Sequence[tuple[str, Profile]]) -> list[tuple[str, Profile]]:
    """Profiles that are not one of those before them."""
    found: list[tuple[str, Profile]] = []
    for name, profile in profiles:
        if profile.blocks and profile not in [p for _, p in found]:
            found.append((name, profile))
    return found


def _seconds(profile: Profile, plan: Plan) -> float:
    return total_seconds(profile.blocks, plan.limits.accel)


def _sizes(rival: Rival) -> str:
    """How large a rival is taken to be: each constant, by its name where that is not the rival's."""
    told = [(name, with_unit(value, PARAMETERS[name][0])) for name, value in rival.values.items()]
    return ", ".join(size if name == rival.name else f"{_plain(name)} {size}" for name, size in told)


def _constants(plan: Plan) -> list[tuple[str, str, list[str], list[str]]]:
    """Of each constant its value, standard errors after each profile, and those as shares of it."""
    rows = []
    for name, std in plan.std.items():
        value, (unit, factor) = plan.rig.model[name], readable(PARAMETERS[name][0], plan.rig.model[name])
        shares = [f"{digits(100.0 * s / abs(value), 2)} %" if value else "–" for s in std]
        rows.append(
            (name, f"{digits(factor * value, 4)} {unit}", [digits(factor * s, 2) for s in std], shares)
        )
    return rows


def _limits(plan: Plan) -> list[tuple[str, str]]:
    limits = plan.limits
    travel = f"{with_unit(limits.low, 'm')} to {with_unit(limits.high, 'm')} from where the log begins"
    return [
        ("speed", with_unit(limits.speed, "rad/s")),
        ("acceleration", with_unit(limits.accel, "rad/s^2") if math.isfinite(limits.accel) else "the command may jump"),
        ("travel", travel if math.isfinite(limits.low) and math.isfinite(limits.high) else "nobody says how far the mass may go"),
        ("time", f"{digits(limits.seconds)} s"),
        ("pitch", ", ".join(f"{digits(p)} deg" for p in limits.pitches)),
        ("logger", f"{digits(limits.rate_hz, 4)} samples a second"),
    ]  # fmt: skip


# --- the charts --------------------------------------------------------------------------------------


def charts(plan: Plan) -> Charts:
    """The planned command over time with its travel and pitch, and below it the simpler one, on one axis."""
    drawn = [("Planned", plan.planned, COMMAND)]
    drawn += [("Simpler", plan.simpler, MUTED)] if plan.simpler != plan.planned else []
    panels = [
        p for name, profile, colour in drawn if profile.blocks for p in _panels(name, profile, colour, plan)
    ]
    return Charts("moves", tuple(panels))


def _panels(name: str, profile: Profile, colour: str, plan: Plan) -> list[Panel]:
    found = course(profile, plan.limits)
    marks = tuple(Mark(at, str(k), INK) for k, at in enumerate(found.begins, start=1))
    unit, factor = readable("m", float(np.abs(found.x).max()))
    several = len(plan.limits.pitches) > 1
    rows = [
        ("commanded speed", "rad/s", found.w, colour, 150, "the motor's speed; a number marks where a line of the list begins"),
        ("travel", unit, factor * found.x, TRAVEL, 90, "how far the mass goes from where the log begins"),
    ]  # fmt: skip
    rows += (
        [("pitch to set", "deg", found.pitch, PITCH, 70, "the level to set in the rest before")]
        if several
        else []
    )
    return [
        Panel(f"{name}: {what}", u, found.t, (Series(what, y, c, 1.6),), f"{name} moves over time: {about}.", link=TIME,
              height=height, marks=marks if what == "commanded speed" else ())
        for what, u, y, c, height, about in rows
    ]  # fmt: skip
