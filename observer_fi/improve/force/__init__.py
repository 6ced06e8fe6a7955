"""The problem of a force that is calculated from the motion."""
