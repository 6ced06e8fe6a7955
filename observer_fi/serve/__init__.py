"""Streams and fleets: the bank on samples as they come, and many logs on several processes."""

from observer_fi.serve import fleet, watch
from observer_fi.serve.live import Live
from observer_fi.serve.watch import Options, Watch

__all__ = [
    "Live",
    "Options",
    "Watch",
    "fleet",
    "watch",
]
