"""What the hypotheses of a bank believe before its first sample."""

import numpy as np

from observer_fi.bank import transition as tr
from observer_fi.bank.bank_state import HypothesisState
from observer_fi.bank.hypotheses import BankArrays, Hypothesis
from observer_fi.physics import Drive, speed
from observer_fi.records import Array

START_ROWS, START_READINGS = (
    64,
    5,
)  # samples looked at for the first readings of a channel, and how many count
REST_VARIANCE = tr.REST_VARIANCE


def start(
    hypotheses: tuple[Hypothesis, ...], b: BankArrays, z0: Array, command0: float, drive: Drive
) -> list[HypothesisState]:
    """Each hypothesis before its first sample: at rest, or turning at the command, where the sensors say.

    z0: (3,) first finite reading of each channel (NaN where there is none). What drives the motor is what its drive says.
    """
    z, out = np.where(np.isfinite(z0), z0, 0.0), []
    for j, h in enumerate(hypotheses):
        model, n = h.model, len(h.states)
        w = speed(z, model.vector) if command0 != 0.0 and model["Km"] else 0.0
        rest = drive.at_rest(z[1], model.vector)
        x, var = b.entry_mean[j, :n].copy(), b.entry_var[j, :n].copy()
        x[:3] = w, rest.I, z[2] / model["position_gain"]
        var[:3] = var[0] if command0 != 0.0 else REST_VARIANCE, rest.I_std**2, 10.0 * b.noise[2]
        slow, bias = (
            tr.slow_at_rest(b.parameters[j]),
            np.array([0.0, b.noise[h.failed] if h.failed >= 0 else 0.0]),
        )
        slow[tr.LAGGED], slow[tr.PHI] = rest.c, _whole_turns(z[2], model["D"])
        out.append(
            HypothesisState(
                x, np.diag(var), slow, bias, np.full(3, np.nan), np.zeros(3), np.full(3, np.nan), np.full(1, np.nan),
                np.zeros(1),
            )
        )  # fmt: skip
    return out


def _whole_turns(x: float, per_rad: float) -> float:
    """Angle of a motor that is at x [m], in whole turns: a position does not tell less [rad]."""
    turn = 2.0 * np.pi * per_rad
    return 2.0 * np.pi * round(x / turn) if turn else 0.0


def first_readings(z: Array) -> Array:
    """(3,) first finite reading of each channel, NaN where there is none; the median of the first few damps noise.

    Only START_ROWS samples are looked at: a stream that begins cannot wait for more.
    """
    first = np.full(3, np.nan)
    for c in range(3):
        good = z[:START_ROWS][np.isfinite(z[:START_ROWS, c]), c][:START_READINGS]
        if good.size:
            first[c] = np.median(good)
    return first
