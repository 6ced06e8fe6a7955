"""docs/causes.md and docs/faults.md from the tables in the code: `python tests/vocabulary_pages.py`."""

from pathlib import Path

from observer_fi.physics import CAUSES, FAULTS, FORCE, MOVES, PARAMETERS, Cause, Coverage

DOCS = Path(__file__).parent.parent / "docs"
WRITTEN = "Written by `python tests/vocabulary_pages.py` from {}; a test keeps it in step."

CAUSES_INTRO = f"""# Causes, and what separates them

What `improve` can name: a term of the [equations](equations.md) that the simulation lacks, of which the logs say how large it is.
{WRITTEN.format("`observer_fi/physics/effects.py`")} Formulas are in the letters of the
equations; a parameter is one that `simulate --effect NAME=VALUE` and a rig file take. [Improving a model](improve.md) says how a
cause is tried, accepted and refused; `plan --between CAUSE,CAUSE` finds the moves that tell two of them apart on your rig.
"""
FAULTS_INTRO = f"""# Faults

What can be the verdict on a move. {WRITTEN.format("the table `FAULTS`")}
[The bank](bank.md) says how a verdict is reached, [reading a page](reading.md) what stands around it.
"""
OF_EQUATION = {
    "torque": "The torque balance", "electrical": "The circuit", "servo": "The servo", "kinematics": "Screw and nut",
    "contact": "The stops", "sensor:position": "The position sensor", "sensor:current": "The current sensor",
    "sensor:voltage": "The voltage sensor", "sensor:pitch": "The inclinometer",
}  # fmt: skip


SOME = Coverage(lead=3.0, orders=(0.5,))  # with a screw and a line in the torque, so that every form is there


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A table of Markdown; bars within a cell are escaped."""
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *lines]) + "\n"


def parameters_of(cause: Cause) -> str:
    """The parameters of all forms of a cause, with their units; for an alias those of what it cannot be told from."""
    terms = [t for v in cause.forms(SOME) for t in v.terms]
    names = dict.fromkeys(n for t in terms for n in (t.parameter, *(other for other, _ in t.with_it)))
    return ", ".join(f"`{name}` [{PARAMETERS[name][0]}]" for name in names) or "those of its equals"


def in_words(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "–"


def seen(cause: Cause) -> str:
    """Where the cause can be shown: on rigs whose moves are simulated, on those that log a force."""
    places = {MOVES: "motor", FORCE: "force"}
    return ", ".join(word for key, word in places.items() if cause.variants(SOME, key)) or "–"


def separation(cause: Cause) -> str:
    """What to record, and the same for a rig that logs a force where that differs."""
    force = f"; where a force is logged: {cause.separate_force}" if cause.separate_force else ""
    return (cause.separate_by or "any move shows it") + force


def causes_page() -> str:
    """The whole of docs/causes.md."""
    parts = [CAUSES_INTRO]
    for equation, title in OF_EQUATION.items():
        inside = [cause for cause in CAUSES.values() if cause.equation == equation]
        parts.append(f"## {title}\n\n`{equation}`\n")
        rows = [(f"`{c.name}`", f"`{c.formula}`", parameters_of(c), seen(c), c.source) for c in inside]
        parts.append(table(("cause", "formula", "parameters", "rigs", "source"), rows))
        apart = [
            (f"`{c.name}`", in_words(c.aliases), in_words(c.confused_with), separation(c)) for c in inside
        ]
        parts.append(table(("cause", "same in every log", "alike in common logs", "told apart by"), apart))
    return "\n".join(parts)


def faults_page() -> str:
    """The whole of docs/faults.md."""
    parts = [FAULTS_INTRO]
    for row in FAULTS.values():
        facts = [
            ("what happened", row.says(row.happened, "named")),
            ("what to do", row.says(row.action, "named")),
            ("what looks alike", " ".join(dict.fromkeys(row.alike.values())) or "–"),
            ("its severity", ", ".join(s.tells.replace("_", " ") for s in row.sizes if s.tells) or "–"),
            ("changes in the plant", ", ".join(f"`{n}` = {v:g}" for n, v in row.plant.items()) or "–"),
            ("hypotheses", in_words(row.modes)),
            ("can be over within a move", "yes" if row.heals else "no"),
            ("the open-loop mixture knows it", "yes" if row.open_loop else "no"),
            ("made by", ", ".join(f"`simulate --fault {kind}`" for kind in row.made_by) or "–"),
        ]
        parts.append(f"## {row.title}\n")
        parts.append(table(("label", f"`{row.label}`"), facts))
    return "\n".join(parts)


PAGES = {DOCS / "causes.md": causes_page, DOCS / "faults.md": faults_page}


def main() -> None:
    for path, page in PAGES.items():
        path.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
