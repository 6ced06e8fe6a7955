"""The paper's bank (three models, three states, three channels) as users of other packages would write it.

Every function takes a log and does its part of the job once over it. The equations stand here a second time, in plain
numpy, on purpose: they are what a straightforward user writes. Speed is compared, not verdicts.
"""

import math
from collections.abc import Callable

import numpy as np

from observer_fi.physics import load_rig
from observer_fi.records import Log

_m = load_rig().model
Rm, Km, D, Vmax, Kp, Ki = (_m[name] for name in ("Rm", "Km", "D", "Vmax", "Kp", "Ki"))
J, A, B, Rs = (_m[name] for name in ("J", "A", "B", "Rs"))
A_LOOSE, SHARE = _m["A_decoupled"], _m["E"]
MODELS = ("nominal", "overload", "coupling_loss")
NOISE = np.diag([0.01, 3e-4, 1e-5]) ** 2
STEP = 1.0 / 1600.0
PROCESS = np.diag([0.1, 3e-5, 5e-7]) ** 2 * STEP
STAY = 0.999
SWITCH = np.full((3, 3), 0.5 * (1.0 - STAY)) + np.eye(3) * (STAY - 0.5 * (1.0 - STAY))


def current(w: float, I: float, w_cmd: float) -> float:
    """Equation 6."""
    wanted = Kp * (w_cmd - w) + Ki * I
    return min(max(wanted, (-Vmax - Km * w) / (Rm + Rs)), (Vmax - Km * w) / (Rm + Rs))


def rates(model: str, x: np.ndarray, w_cmd: float, theta: float) -> np.ndarray:
    """dx/dt of (w, I, x)."""
    w, I = float(x[0]), float(x[1])
    sign = math.copysign(1.0, w) if w else 0.0
    load = A * sign + B * theta
    speed = D * w
    if model == "overload":
        load += 1e-3 * sign
        speed *= SHARE
    elif model == "coupling_loss":
        load, speed = A_LOOSE * sign, 0.0
    return np.array([(Km * current(w, I, w_cmd) - load) / J, w_cmd - w, speed])


def advance(model: str, x: np.ndarray, w_cmd: float, theta: float, dt: float) -> np.ndarray:
    """One Heun step."""
    first = rates(model, x, w_cmd, theta)
    second = rates(model, x + dt * first, w_cmd, theta)
    return x + 0.5 * dt * (first + second)


def jacobian(model: str, x: np.ndarray, w_cmd: float, theta: float, dt: float) -> np.ndarray:
    """d advance / d x by differences."""
    base, F = advance(model, x, w_cmd, theta, dt), np.empty((3, 3))
    for k, h in enumerate((0.1, 1e-4, 1e-6)):
        shifted = x.copy()
        shifted[k] += h
        F[:, k] = (advance(model, shifted, w_cmd, theta, dt) - base) / h
    return F


def readings(x: np.ndarray, w_cmd: float) -> np.ndarray:
    """(V, i, x) of a state."""
    i = current(float(x[0]), float(x[1]), w_cmd)
    return np.array([Rm * i + Km * x[0], i, x[2]])


def readings_jacobian(x: np.ndarray, w_cmd: float) -> np.ndarray:
    """d readings / d x, unsaturated."""
    return np.array([[Km - Rm * Kp, Rm * Ki, 0.0], [-Kp, Ki, 0.0], [0.0, 0.0, 1.0]])


# --- filterpy ---


def filterpy_ekf(log: Log) -> np.ndarray:
    """Three ExtendedKalmanFilters in an IMMEstimator; mode probabilities at the end."""
    from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator

    class Ekf(ExtendedKalmanFilter):
        def __init__(self, model: str) -> None:
            super().__init__(dim_x=3, dim_z=3)
            self.model, self.command = model, (0.0, 0.0)
            self.x, self.P = np.zeros(3), np.diag([1e-3, 1e-4, 1e-5]) ** 2
            self.Q, self.R = PROCESS, NOISE

        def predict(self, u: tuple[float, float]) -> None:
            self.command = u
            self.F = jacobian(self.model, self.x, *u, STEP)
            self.x = advance(self.model, self.x, *u, STEP)
            self.P = self.F @ self.P @ self.F.T + self.Q
            self.x_prior, self.P_prior = self.x.copy(), self.P.copy()

        def update(self, z: np.ndarray) -> None:
            w_cmd = self.command[0]
            super().update(z, lambda x: readings_jacobian(x, w_cmd), lambda x: readings(x, w_cmd))

    return _through(
        IMMEstimator([Ekf(model) for model in MODELS], np.array([0.998, 0.001, 0.001]), SWITCH), log
    )


def filterpy_ukf(log: Log) -> np.ndarray:
    """Three UnscentedKalmanFilters in an IMMEstimator; mode probabilities at the end."""
    from filterpy.kalman import IMMEstimator, MerweScaledSigmaPoints, UnscentedKalmanFilter

    class Ukf(UnscentedKalmanFilter):
        def __init__(self, model: str) -> None:
            points = MerweScaledSigmaPoints(3, alpha=1.0, beta=2.0, kappa=0.0)
            super().__init__(3, 3, STEP, hx=None, fx=None, points=points)
            self.model, self.command = model, (0.0, 0.0)
            self.x, self.P = np.zeros(3), np.diag([1e-3, 1e-4, 1e-5]) ** 2
            self.Q, self.R = PROCESS, NOISE

        def predict(self, u: tuple[float, float]) -> None:
            self.command = u
            super().predict(fx=lambda x, dt: advance(self.model, x, *u, dt))

        def update(self, z: np.ndarray) -> None:
            w_cmd = self.command[0]
            super().update(z, hx=lambda x: readings(x, w_cmd))

    return _through(
        IMMEstimator([Ukf(model) for model in MODELS], np.array([0.998, 0.001, 0.001]), SWITCH), log
    )


def _through(bank: object, log: Log) -> np.ndarray:
    for z, w_cmd, theta in zip(log.z, log.w_cmd.tolist(), log.pitch.tolist(), strict=True):
        bank.predict((w_cmd, theta))  # type: ignore[attr-defined]
        bank.update(z)  # type: ignore[attr-defined]
    return np.asarray(bank.mu)  # type: ignore[attr-defined]


# --- what other packages can do of it ---


def stonesoup_ekf(log: Log) -> np.ndarray:
    """Stone Soup has no interacting bank of these: three ExtendedKalmanPredictors and Updaters side by side."""
    from datetime import datetime, timedelta

    from stonesoup.base import Property
    from stonesoup.models.base import GaussianModel, TimeVariantModel
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.base import TransitionModel
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.types.array import CovarianceMatrix, StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    now = {"w_cmd": 0.0, "theta": 0.0}

    class Motion(TransitionModel, GaussianModel, TimeVariantModel):
        label: str = Property()

        @property
        def ndim_state(self) -> int:
            return 3

        def function(self, state, noise=False, **kwargs):
            x = np.asarray(state.state_vector, dtype=float).ravel()
            return StateVector(advance(self.label, x, now["w_cmd"], now["theta"], STEP))

        def jacobian(self, state, **kwargs):
            x = np.asarray(state.state_vector, dtype=float).ravel()
            return jacobian(self.label, x, now["w_cmd"], now["theta"], STEP)

        def covar(self, **kwargs):
            return CovarianceMatrix(PROCESS)

        def rvs(self, num_samples=1, **kwargs):
            raise NotImplementedError

        def pdf(self, state1, state2, **kwargs):
            raise NotImplementedError

    class Sensors(NonLinearGaussianMeasurement):
        @property
        def ndim_meas(self) -> int:
            return 3

        def function(self, state, noise=False, **kwargs):
            return StateVector(readings(np.asarray(state.state_vector, dtype=float).ravel(), now["w_cmd"]))

        def jacobian(self, state, **kwargs):
            return readings_jacobian(state.state_vector, now["w_cmd"])

    begin = datetime(2000, 1, 1)
    sensors = Sensors(ndim_state=3, mapping=(0, 1, 2), noise_covar=CovarianceMatrix(NOISE))
    predictors = [ExtendedKalmanPredictor(Motion(label=model)) for model in MODELS]
    updater = ExtendedKalmanUpdater(sensors)
    states = [
        GaussianState(
            StateVector([0.0, 0.0, 0.0]), CovarianceMatrix(np.diag([1e-6, 1e-8, 1e-10])), timestamp=begin
        )
        for _ in MODELS
    ]
    for k, z in enumerate(log.z):
        now["w_cmd"], now["theta"] = float(log.w_cmd[k]), float(log.pitch[k])
        time = begin + timedelta(seconds=float(log.t[k]))
        detection = Detection(StateVector(z), timestamp=time, measurement_model=sensors)
        for j, predictor in enumerate(predictors):
            prediction = predictor.predict(states[j], timestamp=time)
            states[j] = updater.update(SingleHypothesis(prediction, detection))
    return np.array([np.asarray(s.state_vector, dtype=float).ravel() for s in states])


def progpy_ukf(log: Log) -> np.ndarray:
    """progpy has one filter of one model at a time: its UnscentedKalmanFilter on the nominal model."""
    from progpy import PrognosticsModel
    from progpy.state_estimators import UnscentedKalmanFilter

    class Shifter(PrognosticsModel):
        inputs = ["w_cmd", "theta"]
        states = ["w", "I", "x"]
        outputs = ["voltage", "current", "position"]
        default_parameters = {
            "x0": {"w": 0.0, "I": 0.0, "x": 0.0},
            "process_noise": {"w": 1e-2, "I": 1e-5, "x": 1e-7},
            "measurement_noise": {"voltage": 0.01, "current": 3e-4, "position": 1e-5},
        }

        def dx(self, x, u):
            values = np.array([float(np.squeeze(x[name])) for name in self.states])
            rate = rates("nominal", values, float(np.squeeze(u["w_cmd"])), float(np.squeeze(u["theta"])))
            return self.StateContainer(dict(zip(self.states, rate.tolist(), strict=True)))

        def output(self, x):
            values = np.array([float(np.squeeze(x[name])) for name in self.states])
            return self.OutputContainer(
                dict(zip(self.outputs, readings(values, self.command).tolist(), strict=True))
            )

    model = Shifter()
    model.command = 0.0
    start = model.StateContainer({"w": 0.0, "I": 0.0, "x": 0.0})
    spread = {"Q": PROCESS, "R": NOISE}
    flt = UnscentedKalmanFilter(model, start, **spread)
    for k, z in enumerate(log.z):
        model.command = float(log.w_cmd[k])
        u = model.InputContainer({"w_cmd": model.command, "theta": float(log.pitch[k])})
        y = dict(zip(model.outputs, z.tolist(), strict=True))
        flt.estimate(float(log.t[k]) + STEP, u, y)
    return np.array([flt.x.mean[name] for name in model.states])


def dynamax_ekf() -> Callable[[Log], np.ndarray]:
    """dynamax has no interacting bank: three of its extended filters, compiled by jax in double precision."""
    import jax
    import jax.numpy as jnp
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter

    jax.config.update("jax_enable_x64", True)

    def servo(x, u):
        wanted = Kp * (u[0] - x[0]) + Ki * x[1]
        return jnp.clip(wanted, (-Vmax - Km * x[0]) / (Rm + Rs), (Vmax - Km * x[0]) / (Rm + Rs))

    def motion(friction: float, pitch: float, extra: float, share: float) -> Callable:
        def rate(x, u):
            load = (friction + extra) * jnp.sign(x[0]) + pitch * u[1]
            return jnp.array([(Km * servo(x, u) - load) / J, u[0] - x[0], share * D * x[0]])

        def step(x, u):
            first = rate(x, u)
            return x + 0.5 * STEP * (first + rate(x + STEP * first, u))

        return step

    def sensors(x, u):
        i = servo(x, u)
        return jnp.array([Rm * i + Km * x[0], i, x[2]])

    forms = ((A, B, 0.0, 1.0), (A, B, 1e-3, SHARE), (A_LOOSE, 0.0, 0.0, 0.0))
    params = [
        ParamsNLGSSM(
            jnp.zeros(3), jnp.diag(jnp.array([1e-6, 1e-8, 1e-10])), motion(*form), PROCESS, sensors, NOISE
        )
        for form in forms
    ]

    @jax.jit
    def bank(z, u):
        return jnp.stack([extended_kalman_filter(p, z, inputs=u).marginal_loglik for p in params])

    def through(log: Log) -> np.ndarray:
        return np.asarray(bank(log.z, np.column_stack((log.w_cmd, log.pitch))))

    return through
