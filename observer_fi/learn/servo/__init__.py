"""The servo of a rig that comes without one, or with no more than a data sheet."""
