"""Records to pages, figures and JSON. Computes nothing."""

from observer_fi.report import diagnosis
from observer_fi.report.chart import Figure, padded
from observer_fi.report.comparison_page import page, table
from observer_fi.report.diagnosis import environment, json_text, versions
from observer_fi.report.diagnosis_figures import COLOURS, MEASURED, MIXTURE, WORDS, colour_of
from observer_fi.report.learning import (
    at_mass,
    form,
    identify_files,
    identify_json,
    improve_files,
    improve_headline,
    improve_json,
)
from observer_fi.report.result_folder import clear_leftovers, write_file, write_folder

__all__ = [
    "COLOURS",
    "Figure",
    "MEASURED",
    "MIXTURE",
    "WORDS",
    "at_mass",
    "clear_leftovers",
    "colour_of",
    "diagnosis",
    "environment",
    "form",
    "identify_files",
    "identify_json",
    "improve_files",
    "improve_headline",
    "improve_json",
    "json_text",
    "padded",
    "page",
    "table",
    "versions",
    "write_file",
    "write_folder",
]
