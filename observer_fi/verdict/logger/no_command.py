"""A log without a commanded speed says nothing of its servo: it is judged as one of a servo that nobody knows.

What is recovered of such a command is made of the readings with the servo's own equation. What that equation then says beside the
readings is how the recovered command is off. Of 152 moves without a command, most of them through one more trait of a logger,
138 were right with the servo's equation and 149 without.
"""

from dataclasses import replace

import numpy as np

from observer_fi.logs import CHUNK_ROWS, is_recovered, with_command
from observer_fi.physics import Rig
from observer_fi.records import Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.as_followed import NOT_FOLLOWED, is_not_followed, with_voltage_ahead
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.logger.lateness import LEAST

NOT_CHECKED = "no commanded speed was logged: what the servo makes of it is not checked"


def with_its_servo(log: Log, rig: Rig) -> tuple[Log, Rig]:
    """The log with its command, and the rig to judge it with: one without its servo where no command was logged, or another one.

    Raises InvalidLogError where nothing tells the speed.
    """
    if is_not_followed(log, rig):
        told = with_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), rig)
        return replace(told, notes=(*log.notes, NOT_FOLLOWED)), rig.without_servo
    told = with_command(log, rig)
    if rig.law is not None or not rig.watched.servo or not is_recovered(told):
        return told, rig
    told = _in_time(log, told, rig)
    return replace(told, notes=tuple(dict.fromkeys((*told.notes, NOT_CHECKED)))), rig.without_servo


def _in_time(log: Log, told: Log, rig: Rig) -> Log:
    """`told`, which is `log` with its command; with one from voltage and current at one time where the first start shows that the
    voltage is later.
    """
    late = AsLogged(told.part(slice(0, CHUNK_ROWS)), rig.without_servo, BankSettings()).lateness
    behind = late.voltage - late.current
    if behind < LEAST:
        return told
    blank = replace(with_voltage_ahead(log, behind / log.rate_hz), w_cmd=np.full(log.t.size, np.nan))
    return replace(with_command(blank, rig), z=log.z)
