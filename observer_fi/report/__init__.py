"""Records to pages, figures and JSON. Computes nothing."""

from observer_fi.report import diagnosis, inverse_learning
from observer_fi.report.chart import Figure, padded
from observer_fi.report.comparison_page import page, table
from observer_fi.report.diagnosis import environment, json_text, versions
from observer_fi.report.diagnosis_figures import COLOURS, MEASURED, MIXTURE, WORDS, colour_of
from observer_fi.report.inverse_learning import fit_table, inverse_files, inverse_headline, scores_table
from observer_fi.report.learning import (
    identify_files,
    identify_json,
    improve_files,
    improve_headline,
    improve_json,
)
from observer_fi.report.result_folder import (
    Made,
    check_beside,
    checked_name,
    clear_leftovers,
    folder_name,
    folder_of,
    ours,
    write_beside,
    write_file,
    write_folder,
    write_result,
)

__all__ = [
    "COLOURS",
    "Figure",
    "MEASURED",
    "MIXTURE",
    "Made",
    "WORDS",
    "check_beside",
    "checked_name",
    "clear_leftovers",
    "colour_of",
    "diagnosis",
    "environment",
    "fit_table",
    "folder_name",
    "folder_of",
    "identify_files",
    "identify_json",
    "improve_files",
    "improve_headline",
    "improve_json",
    "inverse_files",
    "inverse_headline",
    "inverse_learning",
    "json_text",
    "ours",
    "padded",
    "page",
    "scores_table",
    "table",
    "versions",
    "write_beside",
    "write_file",
    "write_folder",
    "write_result",
]
