"""Logs whose channels were read at times of their own and then put on the rows of a table, by a line or a hold."""

import numpy as np
import pandas as pd

READ = ("voltage_v", "current_a", "position_m")


def on_other_clocks(
    frame: pd.DataFrame, hz: tuple[float | None, ...], seed: int, *, jitter: float = 0.0, how: str = "line"
) -> pd.DataFrame:
    """The frame whose channels were read `hz` times a second, at times off by `jitter` of that interval; None: left as they are.

    how: "line" from one reading to the next, or "hold" of the latest one.
    """
    rng, out, t = np.random.default_rng(seed), frame.copy(), frame["time_s"].to_numpy()
    for column, rate in zip(READ, hz, strict=True):
        if rate is None:
            continue
        at = np.arange(t[0] - rng.uniform() / rate, t[-1] + 1.0 / rate, 1.0 / rate)
        at = np.clip(at + rng.uniform(-jitter, jitter, at.size) / rate, t[0], t[-1])
        rows = np.unique(np.searchsorted(t, at))
        y = frame[column].to_numpy()
        if how == "line":
            out[column] = np.interp(t, t[rows], y[rows])
        else:
            out[column] = y[rows[np.searchsorted(rows, np.arange(t.size), side="right") - 1]]
    return out
