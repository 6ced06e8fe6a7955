"""Work arrays of the compiled loops over a bank, and its arrays as rows."""

from typing import NamedTuple

import numpy as np

from observer_fi.bank.packing import BankRows, lined_up
from observer_fi.bank.ukf import UnscentedWork, unscented_work
from observer_fi.numerics import inlined, side_by_side
from observer_fi.records import Array


class WorkArrays(NamedTuple):
    """Work arrays of the loops, which allocate nothing, so that no reference is counted in them (that was 90 % of their time).

    to_x (n, L), to_P (n, n, L): the other side of mixing; off (common, L, L) a source's distance from the mixed mean, by state
    and source, heavy (L, L) that of one state times its weight; weights (L, L) of the sources; M (m, L) the transition matrix
    in use, chain (m, m) that of a time step, mixed (1,) that step, which outlasts a call, square (3, m, m); p (VECTOR_SIZE, L)
    parameters with the factors in the states; g (2, n, L) slopes by constants; into (2, n, L) what constants do to w and x in a
    step; T (3, n, L) covariances of w, I, x after a step with the states before; w (n, L) gains; y, e, S (3, L) predictions,
    innovations and their variances; reached, density, product, strain, nis (1, L); unscented: see there.
    """

    to_x: Array
    to_P: Array
    off: Array
    heavy: Array
    weights: Array
    M: Array
    chain: Array
    square: Array
    p: Array
    g: Array
    into: Array
    T: Array
    w: Array
    y: Array
    e: Array
    S: Array
    reached: Array
    density: Array
    product: Array
    strain: Array
    nis: Array
    mixed: Array
    unscented: UnscentedWork


def work_arrays(b: BankRows) -> WorkArrays:
    """Work arrays for a bank."""
    m, n, c, L = b.m, b.n, b.common, len(b.wide)
    one = np.zeros((1, L))
    made = WorkArrays(
        to_x=np.zeros((n, L)), to_P=np.zeros((n, n, L)), off=np.zeros((c, L, L)), heavy=np.zeros((L, L)),
        weights=np.zeros((L, L)), M=np.zeros((m, L)), chain=np.eye(m), square=np.zeros((3, m, m)), p=b.parameters,
        g=np.zeros((2, n, L)), into=np.zeros((2, n, L)), T=np.zeros((3, n, L)), w=np.zeros((n, L)), y=np.zeros((3, L)),
        e=np.zeros((3, L)), S=np.ones((3, L)), reached=one, density=one, product=one, strain=one, nis=one,
        mixed=np.full(1, -1.0), unscented=unscented_work(n, L),
    )  # fmt: skip
    return lined_up(made)


class Rows(NamedTuple):
    """The arrays of BankState, Scratch and BankRows whose last side is a row, as rows."""

    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    to_x: Array
    to_P: Array
    off: Array
    heavy: Array
    weights: Array
    M: Array
    p: Array
    g: Array
    into: Array
    T: Array
    w: Array
    y: Array
    e: Array
    S: Array
    mu: Array
    reached: Array
    density: Array
    product: Array
    strain: Array
    nis: Array
    has: Array
    holds: Array
    itself: Array
    parameters: Array
    entry_mean: Array
    entry_var: Array
    diffusion: Array
    own: Array
    failed: Array
    failed_noise: Array
    repeat: Array
    sizes: Array
    slow_at_rest: Array


@inlined
def rows_of(b, s, scr):
    """Memory s, scratch and bank as rows."""
    L = b.wide
    return Rows(
        side_by_side(s.x, L), side_by_side(s.P, L), side_by_side(s.slow, L), side_by_side(s.bias, L),
        side_by_side(s.predicted, L), side_by_side(s.glitches, L), side_by_side(scr.to_x, L), side_by_side(scr.to_P, L),
        side_by_side(scr.off, L), side_by_side(scr.heavy, L), side_by_side(scr.weights, L), side_by_side(scr.M, L),
        side_by_side(scr.p, L), side_by_side(scr.g, L), side_by_side(scr.into, L), side_by_side(scr.T, L),
        side_by_side(scr.w, L), side_by_side(scr.y, L), side_by_side(scr.e, L), side_by_side(scr.S, L),
        side_by_side(s.mu, L), side_by_side(scr.reached, L), side_by_side(scr.density, L), side_by_side(scr.product, L),
        side_by_side(scr.strain, L), side_by_side(scr.nis, L), side_by_side(b.has, L), side_by_side(b.holds, L),
        side_by_side(b.itself, L), side_by_side(b.parameters, L), side_by_side(b.entry_mean, L), side_by_side(b.entry_var, L),
        side_by_side(b.diffusion, L), side_by_side(b.own, L), side_by_side(b.failed, L), side_by_side(b.failed_noise, L),
        side_by_side(b.repeat, L), side_by_side(b.sizes, L), side_by_side(b.slow_at_rest, L),
    )  # fmt: skip
