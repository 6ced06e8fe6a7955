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
from observer_fi.report.markdown import markdown_table
from observer_fi.report.result_folder import clear_leftovers, write_file, write_folder

__all__ = [
    "COLOURS",
    "Figure",
    "MEASURED",
    "MIXTURE",
    "WORDS",
    "clear_leftovers",
    "colour_of",
    "diagnosis",
    "environment",
    "fit_table",
    "identify_files",
    "identify_json",
    "improve_files",
    "improve_headline",
    "improve_json",
    "inverse_files",
    "inverse_headline",
    "inverse_learning",
    "json_text",
    "markdown_table",
    "padded",
    "page",
    "scores_table",
    "table",
    "versions",
    "write_file",
    "write_folder",
]
