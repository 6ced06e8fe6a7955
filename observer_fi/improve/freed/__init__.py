"""Each equation set free in turn: how much the data want it, and what its disturbance looks like."""
