"""Steps of readings where they are not the same everywhere: ranges that switch, codes that are missing, dead bands."""

import numpy as np

from observer_fi.numerics import resolution_of
from observer_fi.records import Array

# By which readings are sorted, two bands each; changes of a band that tell its step, and readings that repeat the one before.
OCTAVES, FEWEST = 8, 12
COARSER = 1.5  # times the finest step: another range
# Readings of both codes beside one that never comes, from which it is missing, and how many such codes there are.
BESIDE, MISSING = 12, 2
REPEATS = 0.3  # share of readings that stand, from which there may be a dead band
EDGE, AT_THE_EDGE = 1.3, 8  # times the smallest change, and how many changes there are below that


def step_of(z: Array) -> float | None:
    """The coarsest step in which readings z (n,) come, None where there is none.

    A converter that ranges by itself, and a number with few digits, have larger steps for larger readings. What is reported
    only where it has changed by more than a dead band is within that of the latest report, either way.
    """
    changes = np.diff(z)
    finest = resolution_of(changes)
    step = max(_of_ranges(z, changes, finest or 0.0), finest or 0.0)
    if not step:
        return 2.0 * _dead_band(changes) or None
    return max(step, _of_codes(z, finest)) if finest else step


def _of_ranges(z: Array, changes: Array, finest: float) -> float:
    """The coarsest step of readings of about one size, 0 where none is coarser than the finest of all."""
    sizes = np.maximum(np.abs(z[1:]), np.abs(z[:-1]))
    largest = float(sizes.max())
    if largest == 0.0:
        return 0.0
    bands = np.floor(2.0 * np.log2(largest / np.maximum(sizes, largest * 2.0**-OCTAVES)))
    coarsest = 0.0
    for k in np.unique(bands):
        within = changes[bands == k]
        stand = np.count_nonzero(within == 0.0)
        step = resolution_of(within) if min(stand, within.size - stand) >= FEWEST else None
        if step and step > COARSER * finest:
            coarsest = max(coarsest, step)
    return coarsest


def _of_codes(z: Array, step: float) -> float:
    """The step, twice where codes of a converter never come though both beside them do."""
    codes = np.round((z - z.min()) / step).astype(np.int64)
    _, counts = np.unique(codes, return_counts=True)
    there = np.unique(codes)
    alone = (np.diff(there) == 2) & (np.minimum(counts[1:], counts[:-1]) >= BESIDE)
    return 2.0 * step if np.count_nonzero(alone) >= MISSING else step


def _dead_band(changes: Array) -> float:
    """What a reading must have changed by until it is reported anew, 0 where that is nothing."""
    sizes = np.abs(changes[np.isfinite(changes) & (changes != 0.0)])
    if sizes.size < AT_THE_EDGE or sizes.size > (1.0 - REPEATS) * changes.size:
        return 0.0
    band = float(sizes.min())
    return band if np.count_nonzero(sizes < EDGE * band) >= AT_THE_EDGE else 0.0
