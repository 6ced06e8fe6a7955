"""The bank on filterpy: EKF and UKF of any hypothesis behind predict(u) and update(z), and an IMM in logs over them.

The oracle of `kernels.py`. Both engines take their physics from `transition.py`; here the algebra of Kalman filters is
filterpy's, on vectors of readings, there it is one scalar after the other. Every cure of a trap of filterpy stands here
beside a comment, and has a test (tests/test_observers.py).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from filterpy.kalman import (
    ExtendedKalmanFilter,
    IMMEstimator,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
    unscented_transform,
)
from numpy.typing import NDArray
from scipy.linalg import expm

from observer_fi.bank import transition as tr
from observer_fi.bank import ukf as unscented
from observer_fi.bank.bank_state import UNLIKELY
from observer_fi.bank.compiled_bank import soft_stop, under_way
from observer_fi.bank.first_state import first_readings, held_at_first, start
from observer_fi.bank.hypotheses import BankArrays, Hypothesis, arrays, bank
from observer_fi.bank.imm import NEGLIGIBLE, UNREACHED
from observer_fi.bank.log_feed import CommandStream, LogStream
from observer_fi.bank.motion_moments import meanwhile
from observer_fi.bank.packing import SKIPPED_S, Tuning, tuning
from observer_fi.physics import VMAX, Rig, equations, linear, plant
from observer_fi.records import Array, Estimate, Log
from observer_fi.settings import BankSettings

CHANNELS = range(3)


class Step(NamedTuple):
    """The `u` of predict: one sample interval and what is known at its end.

    dt: length [s], NaN before the first sample; interval (1, 2 m): command at the half-steps [rad/s]; w_cmd: command at
    the end [rad/s]; theta: pitch [deg]; active: whether the sample at its end counts as evidence; now: time at the end [s];
    seen: what current and voltage changed meanwhile (`transition.changed`).
    """

    dt: float
    interval: Array
    w_cmd: float
    theta: float
    active: bool = True
    now: float = 0.0
    seen: tuple[float, float] = (np.inf, np.inf)


class Observer:
    """What both adapters share: the physics of one hypothesis, the gate for glitches, the density of what was read.

    x (n,), P (n, n), SI units, 1-D always: filterpy's default (n, 1) turns into (n, n) at the first 1-D reading.
    After update(z): y (3,) predicted readings, seen (3,) innovations over their standard deviations (NaN where nothing
    was used), nis, and log_density, which is 0 where nothing was measured.
    """

    x: Array
    P: Array

    def _set_up(self, b: BankArrays, tune: Tuning) -> None:
        self.b, self.tune = b, tune
        self.n, self.failed = int(b.size[0]), int(b.failed[0])
        self.x, self.P = np.zeros(self.n), np.eye(self.n)
        self.at, self.base = b.layout[0], b.parameters[0]
        self.has = (self.at >= 0).astype(float)
        self.slow, self.bias, self.glitches = tr.slow_at_rest(self.base), np.zeros(2), np.zeros(3)
        self.grip, self.in_play = (
            1.0,
            0.0,
        )  # share of the screw's travel, and variance [m^2] that a play adds to x
        self.previous = np.full(3, np.nan)
        self.predicted = np.full(3, np.nan)
        self.seen, self.doubt = np.full(3, np.nan), np.ones(3)
        self.nis, self.log_density = 0.0, 0.0
        self.step = Step(np.nan, np.zeros((1, 2)), 0.0, 0.0)
        self.sigma = np.sqrt(b.noise)
        self._p = b.parameters[0].copy()
        self.before = np.zeros((2, self.n))  # slopes

    def predict(self, u: Step) -> None:
        """State at the end of `u`; before the first sample there is nothing to predict, and u is only remembered."""
        self.step = u
        if np.isnan(u.dt):
            return
        self._advance(u)
        if self.failed >= 0:
            self.bias[1] += self.tune.bias_diffusion**2 * self.b.noise[self.failed] * u.dt

    def update(self, z: Array | None) -> None:
        """Takes the readings z (3,) of voltage [V], current [A], position [m]; NaN, or None for all, is a missing one.

        filterpy's update(None) keeps the last likelihood, which a bank then counts again: here it is a density of 1.
        """
        z = np.full(3, np.nan) if z is None else np.asarray(z, dtype=float)
        lost = self._is_lost()
        if lost:
            self._start_anew()
        y, S = self._predicted_readings()
        self.doubt = self._doubt(y)
        accepted = self._weigh(z, y, S)
        self.log_density += self._density_of_failed(z, y, S, accepted)
        if accepted:
            self._correct(z, y, accepted)
        if not self.log_density > tr.LOST:
            self._start_anew()
            lost = True
        if lost:
            self.log_density = tr.LOST
        self.predicted = y
        self.previous = np.where(np.isnan(z), self.previous, z)

    def _is_lost(self) -> bool:
        """Whether the state is beyond what any reading can have meant: numbers that would soon be no numbers."""
        variances = np.diag(self.P)
        far, wide = np.abs(self.x).sum(), np.abs(variances).sum()
        return not (far < tr.FARTHEST and wide < tr.WIDEST and variances.min() > -1.0)

    def _start_anew(self) -> None:
        """Begin again at rest where the sensor last saw the mass, everything else at the entry prior."""
        self.x, self.P = self.b.entry_mean[0, : self.n].copy(), np.diag(self.b.entry_var[0, : self.n])
        if np.isfinite(self.previous[2]):
            self.x[2] = self.previous[2]
        self.slow[:] = tr.slow_at_rest(self.base)
        self.bias[:] = 0.0, self.b.noise[self.failed] if self.failed >= 0 else 0.0

    def _grown_current(self, u: Step) -> float:
        """Variance that I gains in a step."""
        growth = self.b.diffusion[0, 1] * u.dt
        return float(tr.grown_current(growth, u.seen, self.b.noise[1], self.base))

    def _meanwhile(self, of_w: float, of_I: float, g: Array, dt: float) -> Array:
        """(3, 3) what w and I, which grew by variances of_w and of_I in a step, did to w, I, x meanwhile. g: slopes."""
        share = self.tune.meanwhile
        p = meanwhile((0.0,) * 6, share * of_w, share * of_I, g[0, 1], g[1, 0], dt)
        return np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])

    def _slopes(self, u: Step) -> Array:
        """Slopes of dw/dt and dx/dt by the state, (2, n), while sliding; those of dI/dt are -1 for w."""
        x, g, p = self.x, np.zeros((2, self.n)), self._p
        tr.load_parameters(x, self.at, self.has, self.base, p)
        d, torque = (tr.state_or(x, self.at, self.has, kind, 0.0) for kind in (tr.AT_D, tr.AT_TORQUE))
        c = tr.carried_in(self.slow)
        m = plant.Motion(x[0], x[1], x[2], d, c.inner)
        g[0, 0], g[0, 1], g[0, 2], g[1, 0], *rest = linear.motion_slopes(
            m, c.slow, u.interval[0, 0], u.theta, plant.Free(torque, 0.0 * torque), p
        )
        tr.constant_slopes(x, self.at, self.has, x[0], d, *rest, u.theta, p, self.base, g)
        return g

    def _advance(self, u: Step) -> None:
        raise NotImplementedError

    def _predicted_readings(self) -> tuple[Array, Array]:
        """(3,) expected readings, SI, and their covariance (3, 3) without noise of the sensors, unit sigmas."""
        raise NotImplementedError

    def _correct(self, z: Array, y: Array, accepted: list[int]) -> None:
        raise NotImplementedError

    def _moved(self, x: Array, slow: Array, u: Step) -> bool:
        """A mean x (n,) and what it carries (`slow`) a step on, in place; whether the motor rests at the end."""
        tr.load_parameters(x, self.at, self.has, self.base, self._p)
        rests, self.grip = tr.propagate(
            x, self.at, self.has, slow, u.dt, u.now, u.interval, 0, u.w_cmd, u.theta, self._p
        )
        return bool(rests)

    def _mean_moved(self, u: Step) -> tuple[Array, Array, bool]:
        """The filter's mean (n,), what it carries and whether the motor rests, a step on."""
        x, slow = self.x.copy(), self.slow.copy()
        rests = self._moved(x, slow, u)
        before, after = tr.carried_in(self.slow), tr.carried_in(slow)
        self.in_play = tr.play_doubt(before.high - before.low, after.high - after.low)
        delays = tr.delays(self.base)
        if delays.any():
            ends = (*self.x[:3], before), (*x[:3], after)
            tr.delay_readings(slow, delays, *ends, u.interval[0, 0], u.w_cmd, u.now, u.dt, self._p)
        return x, slow, rests

    def _readings(self, x: Array) -> tuple[Array, Array]:
        """(3,) readings that a state x (n,) predicts, SI, and their slopes (3, n)."""
        u, H, supply = self.step, np.zeros((3, self.n)), self.at[tr.AT_SUPPLY]
        tr.load_parameters(x, self.at, self.has, self.base, self._p)
        V, i, seen, V_w, V_I, V_v, i_w, i_I, i_v, x_x = tr.readings(
            *x[:3], tr.carried_in(self.slow), u.w_cmd, self._p, self.base[VMAX]
        )
        H[:, :3] = (V_w, V_I, 0.0), (i_w, i_I, 0.0), (0.0, 0.0, x_x)
        if supply >= 0:
            H[:, supply] = V_v, i_v, 0.0
        return np.array([V, i, seen]), H

    def _doubt(self, y: Array) -> Array:
        """(3,) variance of the channels, unit sigmas: the sensors' noise and the timing of the servo."""
        change = self.tune.timing * (y - self.predicted) / self.sigma
        return 1.0 + np.where(np.isnan(self.predicted), 0.0, change**2)

    def _weigh(self, z: Array, y: Array, S: Array) -> list[int]:
        """Channels that are believed, in order; fills seen, nis and log_density with one channel given those before it.

        One after the other the densities multiply to that of the vector, exactly; filterpy's `likelihood` drops
        eigenvalues of S below 2e-10 of the largest and has a floor at 2e-308.
        """
        e, S = (z - y) / self.sigma, S + np.diag(self.doubt)
        limit = self.tune.glitch
        accepted: list[int] = []
        self.seen = np.full(3, np.nan)
        self.nis, self.log_density = 0.0, 0.0
        for c in CHANNELS:
            if np.isnan(z[c]) or c == self.failed:
                continue
            off, var = _given(e, S, accepted, c)
            self.seen[c] = off / np.sqrt(var)
            glitch = self._is_glitch(c, off * off > limit * limit * var)
            counted = self.tune.glitch_nis if glitch else off * off / var
            self.nis += counted
            self.log_density -= 0.5 * (tr.LOG_2PI + np.log(var) + counted) + np.log(self.sigma[c])
            if not glitch:
                accepted.append(c)
        return accepted

    def _is_glitch(self, c: int, far: bool) -> bool:
        """Whether an innovation of channel c beyond the gate is a glitch: for so many samples and no more."""
        glitch = far and self.glitches[c] < self.tune.glitch_samples
        self.glitches[c] = (self.glitches[c] + glitch) if far else 0.0
        return bool(glitch)

    def _density_of_failed(self, z: Array, y: Array, S: Array, accepted: list[int]) -> float:
        """Log-density of the channel that this hypothesis does not believe; its bias follows."""
        c = self.failed
        if c < 0 or np.isnan(z[c]):
            return 0.0
        doubt, e = self.doubt, (z - y) / self.sigma
        off, var = _given(e, S + np.diag(np.where(np.arange(3) == c, 0.0, doubt)), accepted, c)
        sigma = self.sigma[c]
        before = np.inf if np.isnan(self.previous[c]) else self.previous[c]
        density, *self.bias[:] = tr.failed_channel(
            z[c], before, z[c] - off * sigma, var * sigma**2, sigma * np.sqrt(doubt[c]), self.b.repeat[c], *self.bias,
            self.tune.failed,
        )  # fmt: skip
        return float(density)


def _given(e: Array, S: Array, known: list[int], c: int) -> tuple[float, float]:
    """Innovation c and its variance, given those of the channels `known`; e (3,), S (3, 3) of all."""
    if not known:
        return e[c], S[c, c]
    gain = np.linalg.solve(S[np.ix_(known, known)], S[known, c])
    return e[c] - gain @ e[known], S[c, c] - gain @ S[known, c]


class Ekf(Observer, ExtendedKalmanFilter):
    """filterpy's extended Kalman filter of one hypothesis."""

    def __init__(self, hypothesis: Hypothesis, rig: Rig, settings: BankSettings) -> None:
        ExtendedKalmanFilter.__init__(self, len(hypothesis.states), 3)
        self._set_up(arrays((hypothesis,), rig, settings), tuning(settings))

    def predict_x(self, u: Step) -> None:
        """Mean by the equations themselves, and F and Q for the covariance; filterpy's own takes F @ x for the mean."""
        before, slopes = self.x[0], self._slopes(u)
        self.x, self.slow, self.resting = self._mean_moved(u)
        slopes[1] *= self.grip
        self.F = self._transition(slopes, u.dt)
        self.Q = np.diag(self.b.diffusion[0, : self.n] * u.dt)
        self.Q[1, 1] = self._grown_current(u)
        self.Q[0, 0] += (self.tune.agility * (self.x[0] - before)) ** 2
        moves = 0.0 if self.resting else 1.0
        self.Q[:3, :3] += self._meanwhile(moves * self.Q[0, 0], moves * self.Q[1, 1], slopes, u.dt)
        self.Q[1, 1] += (self.tune.tick * (self.x[0] - before)) ** 2
        self.Q[2, 2] += self.in_play

    def _transition(self, g: Array, dt: float) -> Array:
        """F (n, n) for a step of dt [s], I + G dt + (G dt)^2 / 2 for w, I, x. A motor that rests forgets its speed.

        Second-order terms of I and x by constants are left out: they are 1e-3 of what w passes on a sample later.
        """
        F, d = np.eye(self.n), self.at[tr.AT_D]
        if self.resting:
            F[0, 0] = 0.0
            return F
        by_w, by_x, by_d = g[0, 0], g[0, 2], g[0, d] if d >= 0 else 0.0
        F[0, 0], F[0, 1], F[0, 2], F[1, 0], F[1, 1], F[2, 0], F[2, 1] = linear.motion_transition(
            by_w, g[0, 1], by_x, by_d, g[1, 0], dt
        )
        for k in range(3, self.n):
            F[0, k] = linear.constant_transition(by_w, by_x, by_d, g[0, k], g[1, k], dt)
            F[2, k] = dt * g[1, k]
        if d >= 0:  # an indentation moves with x
            F[d] = F[2]
            F[d, 2] -= 1.0
            F[d, d] += 1.0
        return F

    def _advance(self, u: Step) -> None:
        ExtendedKalmanFilter.predict(self, u)
        if self.resting:
            self.P[0, 0] = tr.held_variance(u.w_cmd)

    def _predicted_readings(self) -> tuple[Array, Array]:
        y, H = self._readings(self.x)
        self.H = H / self.sigma[:, None]
        return y, self.H @ self.P @ self.H.T

    def _correct(self, z: Array, y: Array, accepted: list[int]) -> None:
        ExtendedKalmanFilter.update(
            self,
            (z / self.sigma)[accepted],
            HJacobian=lambda x: self.H[accepted],
            Hx=lambda x: (y / self.sigma)[accepted],
            R=np.diag(self.doubt[accepted]),
        )


def _upper_factor(P: Array) -> Array:
    """U with U' U = P for sigma points; scipy's fails on a covariance that rounding left a little asymmetric or flat."""
    L = np.zeros_like(P)
    unscented.factor(0.5 * (P + P.T), P.shape[0], L)
    return L.T


class Ukf(Observer, UnscentedKalmanFilter):
    """filterpy's unscented Kalman filter of one hypothesis."""

    def __init__(self, hypothesis: Hypothesis, rig: Rig, settings: BankSettings) -> None:
        n = len(hypothesis.states)
        points = MerweScaledSigmaPoints(
            n, unscented.ALPHA, unscented.BETA, unscented.KAPPA, sqrt_method=_upper_factor
        )
        UnscentedKalmanFilter.__init__(self, n, 3, 0.0, hx=None, fx=self._point_moved, points=points)
        self._set_up(arrays((hypothesis,), rig, settings), tuning(settings))

    def _point_moved(self, s: Array, dt: float) -> Array:
        x = s.copy()
        self._moved(x, self.slow.copy(), self.step)
        return x

    def _moments(self, points: Array, Wm: Array, Wc: Array, Q: Array, *_: object) -> tuple[Array, Array]:
        """filterpy's transform of the moved points, and the doubt in a change of speed; at rest as in the EKF."""
        x, P = unscented_transform(points, Wm, Wc, Q)
        of_change = (self.tune.agility * (x[0] - self.x[0])) ** 2
        P[0, 0] += of_change
        moves = 1.0 if points[:, 0].any() else 0.0
        P[:3, :3] += self._meanwhile(
            moves * (Q[0, 0] + of_change), moves * Q[1, 1], self.before, self.step.dt
        )
        P[1, 1] += (self.tune.tick * (x[0] - self.x[0])) ** 2
        P[2, 2] += self.in_play
        if not points[:, 0].any():
            P[0, 0] = tr.REST_VARIANCE  # sigma points break away by themselves
        return x, P

    def predict(self, u: Step) -> None:
        """As `Observer.predict`; a bare UKF would take `u` for its dt."""
        Observer.predict(self, u)
        if np.isnan(u.dt):
            self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    def _start_anew(self) -> None:
        super()._start_anew()
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    def _advance(self, u: Step) -> None:
        self.Q = np.diag(self.b.diffusion[0, : self.n] * u.dt)
        self.Q[1, 1] = self._grown_current(u)
        self.before = self._slopes(u)
        _, after, _ = self._mean_moved(u)
        UnscentedKalmanFilter.predict(self, u.dt, UT=self._moments)
        self.slow = after

    def _predicted_readings(self) -> tuple[Array, Array]:
        self.sigmas_h = np.array([self._readings(s)[0] for s in self.sigmas_f])
        y, S = unscented_transform(self.sigmas_h / self.sigma, self.Wm, self.Wc)
        return y * self.sigma, S

    def _correct(self, z: Array, y: Array, accepted: list[int]) -> None:
        read = iter((self.sigmas_h / self.sigma)[:, accepted])  # the points went through h already
        UnscentedKalmanFilter.update(
            self, (z / self.sigma)[accepted], R=np.diag(self.doubt[accepted]), hx=lambda s: next(read)
        )


class _SameShape:
    """Stands in for a filter while IMMEstimator checks that all have one shape."""

    def __init__(self) -> None:
        self.x, self.P = np.zeros(3), np.eye(3)


class LogIMM(IMMEstimator):
    """filterpy's interacting multiple models with probabilities in logs and hypotheses of different states.

    IMMEstimator insists on equal shapes when it is made, so it is made with stand-ins of the three shared states and gets
    its filters afterwards; what adds up states of different filters is overridden. x (3,), P (3, 3): moments of w, I, x
    over all hypotheses, new arrays every time (filterpy refills its own).

    rates (m, m) per second: M = expm(rates dt), rows sum to one: M[i, j] is from i to j (filterpy's docstring says the
    opposite). source, entry_mean, entry_var: see BankArrays.
    """

    def __init__(
        self, filters: Sequence[Observer], log_mu: Array, b: BankArrays, bias_entry: float, mended: float
    ) -> None:
        m = len(filters)
        super().__init__([_SameShape() for _ in filters], np.ones(m), np.full((m, m), 1.0 / m))
        self.filters = list(filters)
        self.b, self.bias_entry = b, bias_entry
        self.carries = bool(b.parameters[:, equations.EXTENDED].any())
        self.log_mu = np.maximum(log_mu, np.log(UNREACHED))
        self.mu = np.exp(self.log_mu)
        self.mixing, self._dt = False, -1.0
        self.mended, self.stopped = mended, False
        self.chain = np.eye(m)
        self._shared = [[self._look_up(i, j) for j in range(self.N)] for i in range(self.N)]
        self._compute_state_estimate()

    def predict(self, u: Step) -> None:
        """Mixing, unless the sample is no evidence or the first; then every filter's own prediction."""
        self.mixing = bool(u.active) and not np.isnan(u.dt)
        self.stopped |= u.w_cmd == 0.0
        if self.mixing:
            if abs(u.dt - self._dt) > 1e-9 * u.dt:
                self.chain, self._dt = expm(self.b.rates * u.dt), u.dt
            self.M = self.chain
            if self.stopped:
                self.M, self.stopped = np.empty_like(self.chain), False
                tr.renewed(self.chain, self.mended, self.M)
            self._compute_mixing_probabilities()
            self._mix()
        for f in self.filters:
            f.predict(u)
        self._compute_state_estimate()
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()

    def update(self, z: Array | None) -> None:
        """Every filter's update; without any reading the probabilities follow the Markov chain alone."""
        for i, f in enumerate(self.filters):
            f.update(z)
            self.likelihood[i] = f.log_density
        if self.mixing:
            log_mu = np.log(self.cbar) + self.likelihood
            log_mu -= log_mu.max()
            self.log_mu = np.maximum(log_mu - np.log(np.exp(log_mu).sum()), np.log(UNREACHED))
            self.mu = np.exp(self.log_mu)
        self._compute_state_estimate()
        self.x_post, self.P_post = self.x.copy(), self.P.copy()

    def _compute_state_estimate(self) -> None:
        first = np.array([f.x[:3] for f in self.filters])
        self.x = self.mu @ first
        off = first - self.x
        self.P = (off.T * self.mu) @ off + sum(
            p * f.P[:3, :3] for p, f in zip(self.mu, self.filters, strict=True)
        )

    def _mix(self) -> None:
        """New starting moments for every filter; a state that a source lacks comes from the target's entry prior."""
        before = [(f.x, f.P, f.bias.copy(), f.slow) for f in self.filters]
        for j, target in enumerate(self.filters):
            weights = [(i, self.omega[i, j]) for i in range(self.N) if self.omega[i, j] >= NEGLIGIBLE]
            parts = [(w, *self._entered(*before[i][:2], i, j)) for i, w in weights]
            target.x = sum(w * x for w, x, _ in parts)
            target.P = sum(w * (P + np.outer(x - target.x, x - target.x)) for w, x, P in parts)
            self._mix_bias(target, before[j][2], j, weights)
            if self.carries:
                target.slow = sum(w * before[i][3] for i, w in weights)

    def _entered(self, x: Array, P: Array, i: int, j: int) -> tuple[Array, Array]:
        """Moments x, P of source i in the states of target j."""
        at, square, lacks, lacks_either, prior = self._shared[i][j]
        return np.where(lacks, self.b.entry_mean[j, : at.size], x[at]), np.where(
            lacks_either, prior, P[square]
        )

    def _look_up(
        self, i: int, j: int
    ) -> tuple[NDArray[np.int64], tuple, NDArray[np.bool_], NDArray[np.bool_], Array]:
        """Where source i has the states of target j, which it lacks, and the prior of those."""
        n = self.filters[j].n
        at = self.b.source[j, i, :n]
        lacks = at < 0
        return at, np.ix_(at, at), lacks, lacks[:, None] | lacks, np.diag(self.b.entry_var[j, :n])

    def _mix_bias(self, target: Observer, before: Array, j: int, weights: list[tuple[int, float]]) -> None:
        if target.failed < 0:
            return
        entry = np.array([0.0, self.bias_entry**2 * self.b.noise[target.failed]])
        parts = [(w, before if i == j else entry) for i, w in weights]
        mean = sum(w * m for w, (m, _) in parts)
        target.bias[:] = mean, sum(w * (v + (m - mean) ** 2) for w, (m, v) in parts)


class FilterpyBank:
    """The bank of `kernels.Bank` on filterpy: `advance` takes a log, or its next chunk, and returns its Estimate."""

    def __init__(
        self,
        rig: Rig,
        settings: BankSettings,
        hypotheses: tuple[Hypothesis, ...] | None = None,
        filter_kind: str = "ekf",
    ) -> None:
        kinds = {"ekf": Ekf, "ukf": Ukf}
        if filter_kind not in kinds:
            raise ValueError(f"filter_kind must be one of {', '.join(kinds)}, got {filter_kind!r}")
        self.rig, self.settings = rig, settings
        self.hypotheses = bank(rig, settings) if hypotheses is None else hypotheses
        self.arrays = arrays(self.hypotheses, rig, settings)
        self.filters: list[Observer] = [kinds[filter_kind](h, rig, settings) for h in self.hypotheses]
        self.imm: LogIMM | None = None
        self.samples = LogStream()
        self.commands = CommandStream(rig.model, settings.substep_s)
        self.t = np.nan
        self.soft = soft_stop(rig)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples (see Estimate for shapes); the same whether a log comes whole or in chunks."""
        log, own = self.samples.take(log)
        w_cmd, interval = self.commands.intervals(log.t, log.w_cmd)
        imm = self._begin(log, w_cmd) if self.imm is None else self.imm
        active = under_way(interval, w_cmd, log.t, self.t, self.soft)
        n, m = log.t.size, len(self.filters)
        mu, nis, y = np.empty((n, m)), np.empty((n, m)), np.empty((n, m, 3))
        seen, states, density, strain = np.empty((n, 3)), np.empty((n, 4)), np.empty((n, m)), np.empty((n, m))
        for k in range(n):
            dt = min(log.t[k] - self.t, SKIPPED_S) if np.isfinite(self.t) else np.nan
            with np.errstate(
                over="ignore", invalid="ignore"
            ):  # a hypothesis whose numbers overflow starts anew
                grew = tr.changed(log.z, k, self.filters[0].previous, self.settings.meanwhile)
                imm.predict(Step(dt, interval[k : k + 1], w_cmd[k], log.pitch[k], active[k], log.t[k], grew))
                imm.update(log.z[k])
            self.t = log.t[k]
            mu[k] = imm.mu
            nis[k], density[k], strain[k] = np.array(
                [(f.nis, f.log_density, strain_of(f, self.arrays, j)) for j, f in enumerate(self.filters)]
            ).T
            y[k] = [f.predicted for f in self.filters]
            best = self.filters[int(np.argmax(imm.mu))]
            seen[k], states[k] = best.seen, (*best.x[:3], w_cmd[k])
        names = tuple(h.name for h in self.hypotheses)
        return Estimate(log.t, names, mu, nis, y, seen, states, active, density, strain).at(own)

    def _begin(self, log: Log, w_cmd: Array) -> LogIMM:
        held = held_at_first(log.z, w_cmd, log.pitch, self.arrays.noise)
        for f, first in zip(
            self.filters,
            start(
                self.hypotheses,
                self.arrays,
                first_readings(log.z, w_cmd[0]),
                w_cmd[0],
                self.rig.watched,
                held,
            ),
            strict=True,
        ):
            f.x, f.P, f.slow, f.bias = first.x, first.P, first.slow, first.bias
        log_mu = np.full(len(self.filters), np.log(UNLIKELY))
        log_mu[0] = np.log(1.0 - UNLIKELY * (len(self.filters) - 1))
        self.imm = LogIMM(self.filters, log_mu, self.arrays, self.settings.bias_entry, self.settings.mended)
        return self.imm


def strain_of(f: Observer, b: BankArrays, j: int) -> float:
    """How far hypothesis j had to stretch constants that only it has, in prior standard deviations."""
    own: NDArray[np.bool_] = b.own[j, : f.n]
    mean, var = b.entry_mean[j, : f.n][own], b.entry_var[j, : f.n][own]
    return float((np.abs(f.x[own] - mean) / np.sqrt(var)).max(initial=0.0))
