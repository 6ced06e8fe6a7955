"""EMPS as logs of this project: two CSV files with the columns of the contract, in a folder outside the project.

python -m pipelines.convert_emps --data FOLDER --out FOLDER
"""

import argparse
import sys
from pathlib import Path

from observer_fi.errors import InvalidLogError, UsageError
from pipelines.emps import VARIABLE, convert


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help=f"folder of the .mat files ({VARIABLE})")
    parser.add_argument("--out", type=Path, required=True, help="folder for the CSV files")
    args = parser.parse_args(argv)
    try:
        for path in convert(args.data, args.out):
            print(path)
    except (InvalidLogError, UsageError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
