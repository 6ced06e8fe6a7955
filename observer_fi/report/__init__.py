"""Records to pages, figures and JSON. Computes nothing."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from observer_fi.report import diagnosis
from observer_fi.report.diagnosis import environment, json_text, versions
from observer_fi.report.diagnosis_figures import MEASURED
from observer_fi.report.markdown import markdown_table
from observer_fi.report.result_folder import (
    Made,
    check_beside,
    checked_name,
    clear_leftovers,
    folder_name,
    folder_of,
    ours,
    reports_below,
    write_beside,
    write_file,
    write_folder,
    write_result,
)

if TYPE_CHECKING:
    from observer_fi.report.comparison_page import page, table
    from observer_fi.report.fleet_page import page as fleet_html
    from observer_fi.report.inspection import MAP_FILE, inspection_json, inspection_text
    from observer_fi.report.learning import (
        at_mass,
        identify_files,
        identify_json,
        improve_files,
        improve_headline,
        improve_json,
    )
    from observer_fi.report.plan_page import plan_files
    from observer_fi.report.results.figures import stills_of
    from observer_fi.report.results.questions import (
        compare,
        diagnose,
        identify,
        improve,
        simulate,
        trend,
        write_report,
    )
    from observer_fi.report.results.recording import Inspected, Planned, inspect, plan
    from observer_fi.report.results.results import (
        Comparison,
        Diagnosis,
        Identification,
        Improved,
        Life,
    )
    from observer_fi.report.still_figures import still_files
    from observer_fi.report.trend_page import headline as trend_headline
    from observer_fi.report.trend_page import trend_files, trend_json

__all__ = [
    "Comparison",
    "Diagnosis",
    "Figure",
    "Identification",
    "Improved",
    "Inspected",
    "Life",
    "MAP_FILE",
    "MEASURED",
    "Made",
    "Planned",
    "at_mass",
    "check_beside",
    "checked_name",
    "clear_leftovers",
    "compare",
    "diagnose",
    "diagnosis",
    "environment",
    "fleet_html",
    "folder_name",
    "folder_of",
    "identify",
    "identify_files",
    "identify_json",
    "improve",
    "improve_files",
    "improve_headline",
    "improve_json",
    "inspect",
    "inspection_json",
    "inspection_text",
    "json_text",
    "markdown_table",
    "ours",
    "page",
    "plan",
    "plan_files",
    "reports_below",
    "simulate",
    "still_files",
    "stills_of",
    "table",
    "trend",
    "trend_files",
    "trend_headline",
    "trend_json",
    "versions",
    "write_beside",
    "write_file",
    "write_folder",
    "write_report",
    "write_result",
]

# Imported when first used: what a verdict does not need.
_LATER = {
    "comparison_page": ("page", "table"),
    "fleet_page": ("fleet_html",),
    "inspection": ("MAP_FILE", "inspection_json", "inspection_text"),
    "learning": (
        "at_mass",
        "identify_files",
        "identify_json",
        "improve_files",
        "improve_headline",
        "improve_json",
    ),
    "plan_page": ("plan_files",),
    "trend_page": ("trend_files", "trend_headline", "trend_json"),
    "results.questions": ("compare", "diagnose", "identify", "improve", "simulate", "trend", "write_report"),
    "results.figures": ("stills_of",),
    "still_figures": ("still_files",),
    "results.recording": ("Inspected", "Planned", "inspect", "plan"),
    "results.results": ("Comparison", "Diagnosis", "Identification", "Improved", "Life"),
}
_NAMED = {
    "trend_headline": "headline",
    "fleet_html": "page",
}  # where the module calls it otherwise
_MODULE_OF = {name: module for module, names in _LATER.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), _NAMED.get(name, name))
