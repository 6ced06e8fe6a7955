"""Reading costs by format: the same 60 s of samples as CSV, CSV.gz, Parquet, TDMS and LVM."""

import gzip
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from nptdms import ChannelObject, TdmsWriter
from results import micro, record, timed
from sample_logs import COLUMNS, FOLDER, healthy_csv, moves_log

from observer_fi.logs import read_log


def files() -> dict[str, Path]:
    """The log in every format."""
    plain = healthy_csv()
    log = moves_log(60.0)
    table = np.column_stack((log.t, log.z, log.pitch, log.w_cmd))
    packed, parquet = FOLDER / "healthy_60s.csv.gz", FOLDER / "healthy_60s.parquet"
    tdms, lvm = FOLDER / "healthy_60s.tdms", FOLDER / "healthy_60s.lvm"
    packed.write_bytes(gzip.compress(plain.read_bytes(), mtime=0))
    pq.write_table(pa.table(dict(zip(COLUMNS, table.T, strict=True))), parquet)
    with TdmsWriter(tdms) as writer:
        writer.write_segment(
            [ChannelObject("log", name, c) for name, c in zip(COLUMNS, table.T, strict=True)]
        )
    head = [
        "LabVIEW Measurement",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "X_Columns\tOne",
        "***End_of_Header***",
        "",
    ]
    head += ["Channels\t5", "***End_of_Header***", "\t".join(("X_Value", *COLUMNS[1:]))]
    body = ["\t".join(f"{v:.9g}" for v in row) for row in table.tolist()]
    lvm.write_text("\n".join([*head, *body]) + "\n")
    return {"CSV": plain, "CSV.gz": packed, "Parquet": parquet, "TDMS": tdms, "LVM": lvm}


def main() -> int:
    """Each format a few times, whole."""
    rows: list[tuple[object, ...]] = []
    for name, path in files().items():
        try:
            samples = read_log(path).t.size
            cost = timed(lambda path=path: read_log(path))  # type: ignore[misc]
        except ValueError as error:
            rows.append((name, str(error)[:80], "", ""))
            continue
        rows.append(
            (
                name,
                micro(cost.cpu / samples),
                micro(cost.wall / samples),
                f"{path.stat().st_size / samples:.0f}",
            )
        )
    columns = ("format", "processor time a sample [us]", "wall clock a sample [us]", "bytes a sample")
    notes = "`read_log` of 96 000 samples with six columns: reading, cleaning, SHA-256. CSV is read on several threads."
    record("3 reading", "Reading a log", columns, rows, notes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
