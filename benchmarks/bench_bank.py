"""One log through banks: filterpy and other packages, and ours. Microseconds a sample, ratios to filterpy."""

import sys
from collections.abc import Callable
from dataclasses import replace

import peers
from results import micro, record, timed
from sample_logs import moves_log

from observer_fi import kernels
from observer_fi.diagnose import make_bank
from observer_fi.live import Live, Row
from observer_fi.models import load_rig
from observer_fi.records import Log
from observer_fi.scenario import Fault
from observer_fi.settings import BankSettings, Settings

PLAIN = BankSettings(augment=False, unknown=False, sensors=False)
THREE, WHOLE = "3 models x 3 states", "7 hypotheses: constants in doubt, none of these, sensor faults"
COLUMNS = (
    "bank", "what it does", "processor time a sample [us]", "times faster than filterpy EKF", "wall clock a sample [us]"
)  # fmt: skip
NOTES = (
    "Simulated moves of 10 s at 1600 samples/s; slow banks on its first samples. The peers are what a straightforward user "
    "writes: Heun steps in numpy, Jacobians by differences. Compilation is not counted."
)


def ours(settings: BankSettings, kind: str) -> Callable[[Log], object]:
    """A compiled bank over a log."""
    return lambda log: kernels.Bank(load_rig(), settings, filter_kind=kind).advance(log)


def one_by_one(log: Log) -> None:
    """Sample by sample, verdict included, as `watch` does it."""
    live = Live(load_rig(), Settings())
    for values in zip(log.t, *log.z.T, log.pitch, log.w_cmd, strict=True):
        for _ in live.add([Row(*map(float, values))]):
            pass


def oracle(log: Log) -> None:
    """The engine on filterpy."""
    make_bank(load_rig(), Settings(bank=PLAIN), "filterpy", "ekf").advance(log)


BANKS: tuple[tuple[str, str, Callable[[], Callable[[Log], object]], int, int], ...] = (
    ("filterpy EKF, IMM", THREE, lambda: peers.filterpy_ekf, 1600, 5),
    ("filterpy UKF, IMM", THREE, lambda: peers.filterpy_ukf, 1600, 5),
    ("Stone Soup EKF", f"{THREE}, no mixing", lambda: peers.stonesoup_ekf, 800, 3),
    ("progpy UKF", "1 model x 3 states", lambda: peers.progpy_ukf, 400, 3),
    ("dynamax EKF", f"{THREE}, no mixing; compiled, 64 bit", peers.dynamax_ekf, 16000, 5),
    ("ours, EKF", THREE, lambda: ours(PLAIN, "ekf"), 16000, 15),
    ("ours, UKF", THREE, lambda: ours(PLAIN, "ukf"), 16000, 9),
    ("ours, EKF, default bank", WHOLE, lambda: ours(BankSettings(), "ekf"), 16000, 9),
    ("ours, UKF, default bank", WHOLE, lambda: ours(BankSettings(), "ukf"), 16000, 5),
    (
        "ours, default bank and verdict, one sample at a time",
        "as `watch` does it",
        lambda: one_by_one,
        3200,
        3,
    ),
    ("ours, --engine filterpy", f"{THREE}, the oracle", lambda: oracle, 800, 3),
)


def main() -> int:
    """All banks on the same log, in this process."""
    log = moves_log(10.0, Fault("coupling_loss", 7.0))
    rows: list[tuple[object, ...]] = []
    base = 0.0
    for name, what, make, samples, runs in BANKS:
        piece = replace(
            log, t=log.t[:samples], z=log.z[:samples], w_cmd=log.w_cmd[:samples], pitch=log.pitch[:samples]
        )  # fmt: skip
        try:
            bank = make()
            cost = timed(lambda bank=bank, piece=piece: bank(piece), runs)  # type: ignore[misc]
        except ImportError as error:
            rows.append((name, what, "not installed", "", str(error)))
            continue
        each = cost.cpu / samples
        base = base or each
        rows.append((name, what, micro(each), f"{base / each:.3g}", micro(cost.wall / samples)))
    record("1 bank", "Filter banks on one log", COLUMNS, rows, NOTES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
