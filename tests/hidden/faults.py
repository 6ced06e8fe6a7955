"""Faults: an overload, a coupling loss, sensor faults, and faults that belong to no named class."""

from dataclasses import dataclass

import numpy as np

from .plant import CONTACT_REFERENCE_M, Plant
from .rig import Rig

LABELS = ("nominal", "overload", "coupling_loss", "slip", "jam", "sensor_fault", "unknown")
CHANNELS = ("voltage", "current", "position")

# Default size of each sensor fault: V, A, m for a bias; the same a second for a drift; a factor for the rest.
SENSOR_SIZES = {
    "frozen": {"voltage": 0.0, "current": 0.0, "position": 0.0},  # dead constant, as a hung converter gives
    "frozen_noisy": {"voltage": 0.0, "current": 0.0, "position": 0.0},  # constant under the usual noise
    "bias": {"voltage": 1.0, "current": 0.02, "position": 3e-4},
    "drift": {"voltage": 0.5, "current": 0.01, "position": 2e-4},
    "gain": {"voltage": 1.15, "current": 1.5, "position": 1.3},
    "dropout": {"voltage": 0.0, "current": 0.0, "position": 0.0},  # zero under the usual noise
    "noise_burst": {"voltage": 20.0, "current": 20.0, "position": 20.0},
}
# What `draw_move_case` does not draw, V, A, m: a range that ends so far below the reading at the onset; the bit worth so much,
# stuck at what it was not then.
LATER_SENSOR_SIZES = {
    "saturation": {"voltage": 0.5, "current": 6e-3, "position": 2e-4},
    "stuck_bit": {"voltage": 0.5, "current": 6e-3, "position": 2e-4},
}
FAILURES = SENSOR_SIZES | LATER_SENSOR_SIZES

# Default size of each fault outside the named classes, and what it means.
UNKNOWN_SIZES = {
    "friction_jump": 2.0,  # A becomes this many times A
    "half_slip": 0.5,  # the nut slips: x rate becomes this many times D w, torque unchanged
    "resistance_jump": 1.5,  # Rm becomes this many times Rm
    "supply_collapse": 0.5,  # Vmax becomes this many times Vmax
    "periodic_torque": 2e-4,  # amplitude [N m] of a sudden 3 Hz torque
}
# What `draw_move_case` does not draw: faults of the motor's circuit.
LATER_UNKNOWN_SIZES = {
    "weak_magnets": 0.85,  # Km becomes this many times Km
    "worn_brushes": 0.8,  # V more at the brushes
    "open_circuit": 1e4,  # Rm becomes this many times Rm
    "supply_off": 1e-3,  # Vmax becomes this many times Vmax
}
ALL_UNKNOWN = UNKNOWN_SIZES | LATER_UNKNOWN_SIZES
DEFAULT_SIZES = {"slip": 0.5, "jam": 1.0}


@dataclass(frozen=True)
class Obstacle:
    """A spring in the way: its torque on the motor is preload + at_1mm (d / 1 mm)^exponent [N m], d its indentation.

    exponent: 1 a rubber buffer or a coil spring, 1.5 a ball (Hertz), 2 the paper's stop. damping [N m s/m] of the motion into it;
    share_lost of the travel while in contact, as E of the rig.
    """

    at_1mm: float
    exponent: float = 1.0
    preload: float = 0.0
    damping: float = 0.0
    share_lost: float = 0.0


@dataclass(frozen=True)
class Fault:
    """One fault. label: of LABELS; onset_s on the log's clock.

    kind: for "sensor_fault" one of FAILURES, with channel of CHANNELS; for "unknown" of ALL_UNKNOWN.
    size: as in those tables, None = theirs; of a slip the share of the travel that is lost, of a jam by how many times its
    friction rises. duration_s: how long it lasts. growth_s: over what time a slip or a jam reaches its size.
    """

    label: str = "nominal"
    onset_s: float | None = None
    kind: str = ""
    channel: str | None = None
    size: float | None = None
    duration_s: float = np.inf
    growth_s: float = 0.0
    obstacle: Obstacle | None = None

    def __post_init__(self):
        kinds = {"sensor_fault": tuple(FAILURES), "unknown": tuple(ALL_UNKNOWN)}.get(self.label, ("",))
        if self.label not in LABELS or self.kind not in kinds:
            raise ValueError(f"{self.label!r} of kind {self.kind!r}: labels are {LABELS}, kinds {kinds}")
        if (self.label == "nominal") != (self.onset_s is None):
            raise ValueError("a fault needs an onset, and no fault has none")
        if self.obstacle is not None and self.label != "overload":
            raise ValueError(f"{self.label!r} meets no obstacle")
        if self.growth_s and self.label not in DEFAULT_SIZES:
            raise ValueError(f"{self.label!r} does not grow: {', '.join(DEFAULT_SIZES)} do")
        if (self.label == "sensor_fault") != (self.channel in CHANNELS):
            raise ValueError(
                f"channel {self.channel!r}: a sensor fault has one of {CHANNELS}, others have none"
            )

    @property
    def magnitude(self) -> float:
        if self.size is not None:
            return self.size
        if self.label == "sensor_fault":
            return FAILURES[self.kind][self.channel]
        if self.label in DEFAULT_SIZES:
            return DEFAULT_SIZES[self.label]
        return ALL_UNKNOWN.get(self.kind, 0.0)


NO_FAULT = Fault()


def faulty_plant(plant: Plant, rig: Rig, fault: Fault, direction: float) -> Plant:
    """The plant from the onset on. direction: sign of the move at onset, where an obstacle stands."""
    if fault.label == "overload":
        return _against(plant, fault.obstacle)._replace(stop_here=direction)
    if fault.label == "coupling_loss":
        return _decoupled(plant, rig)
    if fault.label == "slip":
        return plant._replace(slip=fault.magnitude, slip_start=fault.onset_s, slip_time=fault.growth_s)
    if fault.label == "jam":
        return plant._replace(jam=fault.magnitude, jam_start=fault.onset_s, jam_time=fault.growth_s)
    if fault.label == "unknown":
        return _unknown(plant, fault)
    return plant


def _against(plant: Plant, obstacle: Obstacle | None) -> Plant:
    """Where both stops are of the obstacle's law."""
    if obstacle is None:
        return plant
    return plant._replace(
        C=obstacle.at_1mm / CONTACT_REFERENCE_M**2,
        E=float(obstacle.share_lost),
        contact_exponent=float(obstacle.exponent),
        contact_preload=float(obstacle.preload),
        contact_damping=float(obstacle.damping),
    )


def _decoupled(plant: Plant, rig: Rig) -> Plant:
    """Eq. 12-13: A', J', x frozen. What the mass felt (pitch, stops, its place on the rails) is gone."""
    return plant._replace(
        A=rig.A_loose,
        J=rig.J_loose,
        D=0.0,
        B=0.0,
        C=0.0,
        contact_damping=0.0,
        friction_gradient=0.0,
        gravity_cubic=0.0,
        gravity_cosine=0.0,
        bump_peak=0.0,
        pitch_speed=0.0,
    )


def _unknown(plant: Plant, fault: Fault) -> Plant:
    size = fault.magnitude
    changes = {
        "friction_jump": {"A": plant.A * size},
        "half_slip": {"D": plant.D * size},
        "resistance_jump": {"Rm": plant.Rm * size},
        "supply_collapse": {"Vmax": plant.Vmax * size},
        "periodic_torque": {"shake_amplitude": size, "shake_start": fault.onset_s},
        "weak_magnets": {"Km": plant.Km * size},
        "worn_brushes": {"brush_drop": plant.brush_drop + size},
        "open_circuit": {"Rm": plant.Rm * size},
        "supply_off": {"Vmax": plant.Vmax * size},
    }
    return plant._replace(**changes[fault.kind])


def spoil_channel(fault: Fault, channel: str, times, clean, noise, clean_at_onset: float):
    """What the logger sees of one channel: `clean + noise`, or what the fault makes of them."""
    seen = clean + noise
    if fault.label != "sensor_fault" or fault.channel != channel:
        return seen
    since = times - fault.onset_s
    size = fault.magnitude
    faulty = {
        "frozen": np.full_like(seen, clean_at_onset),
        "frozen_noisy": clean_at_onset + noise,
        "bias": seen + size,
        "drift": seen + size * since,
        "gain": clean * size + noise,
        "dropout": noise,
        "noise_burst": clean + noise * size,
        "saturation": np.clip(seen, *_range_left(size, clean_at_onset)),
        "stuck_bit": seen + size * (1.0 - _bit(clean_at_onset, size) - _bit(seen, size)),
    }[fault.kind]
    return np.where((since >= 0.0) & (since < fault.duration_s), faulty, seen)


def _range_left(size: float, clean_at_onset: float):
    """The range of a sensor that saturates, `size` short of what it read."""
    limit = max(abs(clean_at_onset) - size, 0.0)
    return -limit, limit


def _bit(value, size: float):
    """The bit worth `size`, of two's complement."""
    return np.floor(value / size) % 2.0 if size else 0.0
