"""One log through banks: filterpy and other packages, and ours. Microseconds a sample, ratios to filterpy."""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import peers
from results import micro, record, timed_against
from sample_logs import moves_log

from observer_fi.bank import FilterpyBank, Hypothesis, bank
from observer_fi.bank import compiled_bank as kernels
from observer_fi.learn import prepare, residuals
from observer_fi.logs import Row
from observer_fi.physics import Fault, load_rig
from observer_fi.records import Log
from observer_fi.serve import Live
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict import make_bank

PLAIN = BankSettings(augment=False, unknown=False, sensors=False)
RIG = load_rig()
MOTION = tuple(replace(h, states=("w", "I", "x")) for h in bank(RIG, PLAIN))  # as the peers' three models
PAIR = bank(RIG, BankSettings())[:2]
THREE, WHOLE = "3 models x 3 states", "7 hypotheses: constants in doubt, none of these, sensor faults"
LIKELIHOOD = "likelihood of nominal and overload over a log, constants in doubt"
YARDSTICK = 800  # samples of filterpy's EKF beside every run
COLUMNS = (
    "bank", "what it does", "processor time a sample [us]", "times faster than filterpy EKF", "wall clock a sample [us]"
)  # fmt: skip
NOTES = (
    "Simulated moves of 60 s at 1600 samples/s; slow banks on the first samples. The peers are what a straightforward user "
    "writes: Heun steps in numpy, Jacobians by differences. Compilation is not counted. Times "
    "faster: the median over pairs, each run beside one of filterpy's EKF, as the machine changes its pace."
)


def ours(
    settings: BankSettings, kind: str, hypotheses: tuple[Hypothesis, ...] | None = None
) -> Callable[[Log], object]:
    """A compiled bank over a log."""
    return lambda log: kernels.Bank(RIG, settings, hypotheses, filter_kind=kind).advance(log)


def output_error(log: Log) -> Callable[[Log], object]:
    """One pass of the likelihood that `identify` climbs: the moves of a log run open loop, against the data."""
    moves = prepare([log], RIG)
    still = np.zeros((moves.moves, 2))
    return lambda _: residuals(moves, RIG.model, still)


def one_by_one(log: Log) -> None:
    """Sample by sample, verdict included, as `watch` does it."""
    live = Live(RIG, Settings())
    for values in zip(log.t, *log.z.T, log.pitch, log.w_cmd, strict=True):
        for _ in live.add([Row(*map(float, values))]):
            pass


def oracle(log: Log) -> None:
    """The engine on filterpy."""
    make_bank(RIG, Settings(bank=PLAIN), "filterpy", "ekf").advance(log)


def oracle_likelihood(log: Log) -> None:
    """Two hypotheses through filterpy."""
    FilterpyBank(RIG, BankSettings(), PAIR).advance(log)


BANKS: tuple[tuple[str, str, Callable[[], Callable[[Log], object]], int, int], ...] = (
    ("filterpy EKF, IMM", THREE, lambda: peers.filterpy_ekf, 1600, 5),
    ("filterpy UKF, IMM", THREE, lambda: peers.filterpy_ukf, 1600, 5),
    ("Stone Soup EKF", f"{THREE}, no mixing", lambda: peers.stonesoup_ekf, 800, 3),
    ("progpy UKF", "1 model x 3 states", lambda: peers.progpy_ukf, 400, 3),
    ("dynamax EKF", f"{THREE}, no mixing; compiled, 64 bit", peers.dynamax_ekf, 16000, 5),
    ("ours, EKF", THREE, lambda: ours(PLAIN, "ekf", MOTION), 96000, 15),
    (
        "ours, EKF, an indentation in the overload",
        "3 models x 3, 4 and 3 states",
        lambda: ours(PLAIN, "ekf"),
        96000,
        15,
    ),
    ("ours, UKF", THREE, lambda: ours(PLAIN, "ukf", MOTION), 16000, 9),
    ("ours, EKF, default bank", WHOLE, lambda: ours(BankSettings(), "ekf"), 96000, 9),
    ("ours, UKF, default bank", WHOLE, lambda: ours(BankSettings(), "ukf"), 16000, 5),
    (
        "ours, default bank and verdict, one sample at a time",
        "as `watch` does it",
        lambda: one_by_one,
        3200,
        3,
    ),
    ("ours, --engine filterpy", f"{THREE}, the oracle", lambda: oracle, 800, 3),
    ("ours, prediction error", f"{LIKELIHOOD}, 20 s", lambda: ours(BankSettings(), "ekf", PAIR), 32000, 9),
    ("the same through filterpy", f"{LIKELIHOOD}, its first 2 s", lambda: oracle_likelihood, 3200, 3),
)


def first(log: Log, samples: int) -> Log:
    """The first samples of a log."""
    return replace(
        log, t=log.t[:samples], z=log.z[:samples], w_cmd=log.w_cmd[:samples], pitch=log.pitch[:samples]
    )


def main() -> int:
    """All banks on the same log, in this process, each run beside one of filterpy's."""
    log, campaign = moves_log(60.0, Fault("coupling_loss", 49.0)), moves_log(20.0)
    rows: list[tuple[object, ...]] = []
    short = first(log, YARDSTICK)
    banks = (*BANKS, ("ours, output error", "one pass of the likelihood of `identify`, a campaign of 20 s",
                      lambda: output_error(campaign), campaign.t.size, 9))  # fmt: skip
    for name, what, make, samples, runs in banks:
        piece = first(log, samples)
        try:
            bank = make()
            cost, ratio = timed_against(
                lambda bank=bank, piece=piece: bank(piece),  # type: ignore[misc]
                lambda: peers.filterpy_ekf(short),
                runs,
            )
        except ImportError as error:
            rows.append((name, what, "not installed", "", str(error)))
            continue
        times = ratio * samples / YARDSTICK
        rows.append((name, what, micro(cost.cpu / samples), f"{times:.3g}", micro(cost.wall / samples)))
    record("1 bank", "Filter banks on one log", COLUMNS, rows, NOTES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
