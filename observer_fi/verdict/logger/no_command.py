"""A log without a commanded speed says nothing of its servo: it is judged as one of a servo that nobody knows.

What is recovered of such a command is made of the readings with the servo's own equation. What that equation then says beside the
readings is how the recovered command is off. Of 152 moves without a command, most of them through one more trait of a logger,
138 were right with the servo's equation and 149 without.
"""

from dataclasses import replace

import numpy as np

from observer_fi.logs import is_recovered, with_command
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
    log = with_command(log, rig)
    if rig.law is not None or not rig.watched.servo or not is_recovered(log):
        return log, rig
    log = replace(log, notes=(*log.notes, NOT_CHECKED))
    return _in_time(log, rig), rig.without_servo


def _in_time(log: Log, rig: Rig) -> Log:
    """`log` with a command from voltage and current at one time, where its first start shows that the voltage is later."""
    late = AsLogged(log, rig.without_servo, BankSettings()).lateness
    behind = (late.voltage - late.current) / log.rate_hz
    if behind < LEAST / log.rate_hz:
        return log
    blank = replace(with_voltage_ahead(log, behind), w_cmd=np.full(log.t.size, np.nan))
    return replace(log, w_cmd=with_command(blank, rig).w_cmd)
