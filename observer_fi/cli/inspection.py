"""The command on files as they are: inspect."""

import argparse
from typing import TYPE_CHECKING, Any

from observer_fi.cli.options import OK, USAGE, add_common, add_logs, add_rig, complain, emit_json, taken
from observer_fi.errors import InvalidLogError

if TYPE_CHECKING:
    from observer_fi.logs import Inspection


def inspect_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `inspect`."""
    add_logs(parser)
    add_rig(parser, settings=False)
    parser.add_argument(
        "--write",
        action="store_true",
        help="write the proposed column map as columns.toml into the output folder",
    )
    add_common(parser)


def run_inspect(args: argparse.Namespace) -> int:
    """What each file holds; one that is no table never stops the others."""
    from observer_fi.logs import inspect_log, load_columns
    from observer_fi.physics import load_rig
    from observer_fi.report import folder_name, inspection_json, inspection_text

    columns = load_columns(args.columns) if args.columns else None
    rig = load_rig(args.rig) if args.rig else None
    names = {path: folder_name(args.name, path) for path in dict.fromkeys(args.logs)}
    shown: list[dict[str, Any]] = []
    for path in names:
        try:
            found = inspect_log(path, columns, rig)
        except InvalidLogError as error:
            complain(str(error))
            shown.append({"path": path, "error": str(error)})
            continue
        shown.append(inspection_json(found))
        if not args.quiet and not args.json:
            print(("\n" if len(shown) > 1 else "") + inspection_text(found), end="")
        if args.write:
            _write(args, found, names[path])
    if args.json and (len(names) > 1 or "error" not in shown[0]):
        emit_json(shown if len(names) > 1 else shown[0])
    return USAGE if any("error" in result for result in shown) else OK


def _write(args: argparse.Namespace, found: "Inspection", name: str) -> None:
    from observer_fi.logs import digest_of
    from observer_fi.report import MAP_FILE, Made, write_result

    path = found.contents.path
    made = Made("inspect", {path: digest_of(path)})
    folder = write_result(args.out, name, made, {MAP_FILE: found.column_map})
    taken(path, name, folder)
    if not args.quiet and not args.json:
        print(f"written: {folder / MAP_FILE}")
