"""The hidden truth: a simulator that shares no code with the package, for tests that must find the answer."""

from .answers import Size, right_size
from .cases import (
    FAILING_SIGMAS,
    SEVERITY_KINDS,
    draw_effect_case,
    draw_effects_case,
    draw_failing_case,
    draw_move_case,
    draw_severity_case,
)
from .effects import ALL, CAUSES, OUTSIDE, Effect, effect, sized_effect
from .faults import CHANNELS, FAILURES, NO_FAULT, SENSOR_SIZES, UNKNOWN_SIZES, Fault
from .loggers import IDEAL, PAIRS, TRAITS, TRIPLES, Trait, combined, make_log_with, trait_of
from .profiles import (
    SHAPES,
    Move,
    Profile,
    campaign,
    contact_campaign,
    rich_campaign,
    single_move,
    there_and_back,
)
from .rig import TABLE_1, Rig, draw_rest_integral, draw_rig
from .sensors import Logger
from .truth import TruthSpec, make_log, make_log_through, true_motion, without_noise, write_log

__all__ = [
    "ALL",
    "CAUSES",
    "CHANNELS",
    "FAILING_SIGMAS",
    "FAILURES",
    "IDEAL",
    "NO_FAULT",
    "OUTSIDE",
    "PAIRS",
    "SENSOR_SIZES",
    "SEVERITY_KINDS",
    "SHAPES",
    "TABLE_1",
    "TRAITS",
    "TRIPLES",
    "UNKNOWN_SIZES",
    "Effect",
    "Fault",
    "Logger",
    "Move",
    "Profile",
    "Rig",
    "Size",
    "Trait",
    "TruthSpec",
    "campaign",
    "combined",
    "contact_campaign",
    "draw_effect_case",
    "draw_effects_case",
    "draw_failing_case",
    "draw_move_case",
    "draw_rest_integral",
    "draw_rig",
    "draw_severity_case",
    "effect",
    "make_log",
    "make_log_through",
    "make_log_with",
    "rich_campaign",
    "right_size",
    "single_move",
    "sized_effect",
    "there_and_back",
    "trait_of",
    "true_motion",
    "without_noise",
    "write_log",
]
