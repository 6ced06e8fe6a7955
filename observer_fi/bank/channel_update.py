"""What both kinds of filter do with a reading, compiled: a gate for glitches, doubt in the timing, a channel that failed.

Hypotheses stand side by side (`bank_rows.py`).
"""

import math

from observer_fi.bank import transition as tr
from observer_fi.numerics import inlined, sqrt, where_above, zeros_like


@inlined
def gate(tune, r, c, e, S):
    """Gain of channel c over P h', its NIS, and twice its log-density without the variance, which goes into r.product.

    A glitch, an innovation e of variance S beyond `glitch` standard deviations for at most `glitch_samples`, counts
    `glitch_nis` and moves nothing; nor does a channel that a hypothesis does not believe.
    """
    believed, per_S, limit, count = 1.0 - r.failed[c], 1.0 / S, tune.glitch * tune.glitch, r.glitches[c]
    far = where_above(e * e, limit * S, 1.0, 0.0)
    glitch = where_above(tune.glitch_samples, count, far, 0.0)
    r.glitches[c] = where_above(believed, 0.5, far * (count + glitch), count)
    r.e[c], r.S[c] = e, S
    r.product[0] = r.product[0] * where_above(believed, 0.5, S, 1.0)
    nis = believed * where_above(glitch, 0.5, tune.glitch_nis, e * e * per_S)
    return where_above(glitch, 0.5, 0.0, believed * per_S), nis, -believed * tr.LOG_2PI - nis


@inlined
def doubted(b, tune, r, c):
    """Variance of channel c without the state's: the sensor's noise, and what the timing of the servo puts in doubt."""
    change = tune.timing * (r.y[c] - r.predicted[c])
    return b.noise[c] + where_above(change * change, 0.0, change * change, 0.0)


@inlined
def of_failed(b, tune, r, z, row, previous, expected, variance):
    """Log-density of the channels that hypotheses do not believe, and their biases in place.

    z (n, 3) readings, previous (3,) the ones before; expected, variance: three rows, what the states predict.
    """
    none = zeros_like(r.nis[0])
    reading, before, y, spread, noise, there = none, none, none, 1.0 + none, 1.0 + none, none
    for c in range(3):
        if z[row, c] == z[row, c]:
            mine, last = r.failed[c], previous[c] if previous[c] == previous[c] else math.inf
            reading, there = where_above(mine, 0.5, z[row, c], reading), where_above(mine, 0.5, 1.0, there)
            before, noise = (
                where_above(mine, 0.5, last, before),
                where_above(mine, 0.5, doubted(b, tune, r, c), noise),
            )
            y, spread = where_above(mine, 0.5, expected[c], y), where_above(mine, 0.5, variance[c], spread)
    density, mean, left = tr.failed_channel(
        reading, before, y, spread, sqrt(noise), r.repeat[0], r.bias[0], r.bias[1], tune.failed
    )
    r.bias[0], r.bias[1] = where_above(there, 0.5, mean, r.bias[0]), where_above(there, 0.5, left, r.bias[1])
    return where_above(there, 0.5, density, 0.0)
