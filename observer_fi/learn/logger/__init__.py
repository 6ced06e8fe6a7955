"""Filters that a logger puts before readings, in the model of the readings of a fit, and which of them a campaign has."""
