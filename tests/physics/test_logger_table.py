"""What a rig file keeps of a logger: numbers of numpy like others, and nothing that is empty."""

import tomllib
from dataclasses import replace

import numpy as np

from observer_fi.physics.logger_table import without_nothing
from observer_fi.physics.rigs import load_rig, rig_toml
from observer_fi.records import Acquisition, ChannelTraits, Clock


def test_nothing_and_empty_lists_go_and_numbers_of_numpy_stay() -> None:
    table = {"a": {"x": None, "y": [], "z": np.float64(0.0)}, "b": {"x": None}}
    assert without_nothing(table) == {"a": {"z": 0.0}}


def test_a_rig_is_written_with_what_was_measured_of_coloured_noise() -> None:
    traits = ChannelTraits(np.float64(0.1), np.float64(0.4), correlation_s=np.float64(0.012))
    rig = replace(load_rig(), logger=Acquisition(traits, traits, traits, Clock(0.0, None, 1e-3)))
    written = tomllib.loads(rig_toml(rig))["acquisition"]
    assert written["voltage_v"]["correlation_s"] == 0.012 and "resolution" not in written["voltage_v"]
