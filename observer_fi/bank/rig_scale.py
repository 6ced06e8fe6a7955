"""How large a rig is beside the paper's, whose numbers stand in the settings and in `FAULTS`."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

from observer_fi.physics import Model, Rig, load_rig
from observer_fi.settings import BankSettings


@cache
def _papers() -> Model:
    """The rig that the settings were found on, from its file."""
    return load_rig().model


class Scale(NamedTuple):
    """Torques, currents, travel and the servo's error integral of a rig, 1 where they are the paper's.

    What holds a mass and what starts it both count, whichever is larger.
    """

    torque: float
    current: float
    travel: float
    integral: float

    def of(self, state: str) -> float:
        """The scale of a state in its own unit; factors and the motor's speed have none: motors turn alike."""
        return {
            "I": self.integral,
            "x": self.travel,
            "d": self.travel,
            "rate": self.travel,
            "torque": self.torque,
        }.get(state, 1.0)


def scale_of(model: Model) -> Scale:
    """That of a rig with a motor."""
    paper = _papers()
    torque = max(model["A"] / paper["A"], model["J"] / paper["J"])
    held = model["Km"] * model["Ki"]
    integral = (
        (model["A"] / held) / (paper["A"] / (paper["Km"] * paper["Ki"])) if held and model["A"] else 1.0
    )
    return Scale(torque, torque * paper["Km"] / model["Km"], model["D"] / paper["D"], integral)


def usual_errors(settings: BankSettings, rig: Rig) -> dict[str, float]:
    """Errors of the equations of a rig, as in its file, that settings alone give it."""
    scale, model = scale_of(rig.model), rig.model
    free = settings.free_current * scale.current
    of_servo = settings.diffusion["I"] * scale.integral * model["Ki"] if rig.watched.servo else free
    return {
        "torque": settings.diffusion["w"] * model["J"],
        "servo": of_servo,
        "change": settings.agility,
        "travel": settings.diffusion["x"] * scale.travel,
        "friction": settings.wander["A"],
    }


def with_errors(settings: BankSettings, rig: Rig) -> BankSettings:
    """Settings with the errors of a rig's file; those that it has not as they are."""
    errors = usual_errors(settings, rig) | rig.errors
    scale, model = scale_of(rig.model), rig.model
    diffusion = {"w": errors["torque"] / model["J"], "x": errors["travel"] / scale.travel}
    changed = replace(settings, agility=errors["change"], wander=_wandering(settings, errors["friction"]))
    if not rig.watched.servo:
        free = errors["servo"] / scale.current
        return replace(changed, free_current=free, diffusion=settings.diffusion | diffusion)
    diffusion["I"] = errors["servo"] / (scale.integral * model["Ki"])
    return replace(changed, diffusion=settings.diffusion | diffusion)


def with_servo_error(settings: BankSettings, rig: Rig, least: float) -> BankSettings:
    """Settings in which the error of the servo's equation, of an unknown servo all that it does, is no less than `least`
    [A per root of a second].
    """
    scale = scale_of(rig.model)
    if not rig.watched.servo:
        return replace(settings, free_current=max(least / scale.current, settings.free_current))
    least /= scale.integral * rig.model["Ki"]
    return replace(settings, diffusion=settings.diffusion | {"I": max(least, settings.diffusion["I"])})


class Room(NamedTuple):
    """What a day brings to the mechanics. friction: growth of its relative deviation per root of a second; torque: errors of the
    motor's torque over the usual ones.
    """

    friction: float
    torque: float


# A torque of 3 % of the friction that swells at 1.1 Hz, or a pitch that is told late, is likeliest with the first or the second
# one; a ripple of 3 % with every turn of the shaft, too fast for any wandering constant, with the third one.
ROOMS = (Room(0.02, 1.0), Room(0.035, 1.0), Room(0.02, 20.0))


def with_room(settings: BankSettings, room: Room) -> BankSettings:
    """Settings in which friction, coupled or not, has room for what a day brings: a torque that swells, ripples or is late."""
    wider = {"w": room.torque * settings.diffusion["w"]}
    return replace(settings, wander=_wandering(settings, room.friction), diffusion=settings.diffusion | wider)


def _wandering(settings: BankSettings, friction: float) -> dict[str, float]:
    """Growth of the deviations of constants, with that of every friction."""
    return settings.wander | {"A": friction, "A_decoupled": friction}


PAPERS_HZ = 1600.0  # samples a second of the paper, for which the settings' agility was found
# Below so many an unknown servo does more in an interval than lets the filters foretell a reading: in steady motion they are wide
# beside a reading that stands, which is no news of its sensor. At 250 Hz one whose torque is fed forward still does.
SLOW_HZ = 275.0


def between_samples(settings: BankSettings, rig: Rig, rate_hz: float) -> BankSettings:
    """Settings for a rig and a log of so many samples a second: with the errors of its equations that healthy logs have shown;
    what an unknown servo does between two samples puts its speed in doubt, and of slow ones no repeated reading counts.
    """
    settings = with_errors(settings, rig) if rig.errors else settings
    if rig.watched.servo or rate_hz >= PAPERS_HZ:
        return settings
    if rate_hz > SLOW_HZ:
        return replace(settings, agility=settings.agility * PAPERS_HZ / rate_hz)
    return replace(settings, repeat_weight=0.0, meanwhile=1.0)
