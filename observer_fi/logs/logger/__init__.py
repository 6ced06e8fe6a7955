"""What a logger does to its readings: measured from a log, and what of them filters may take."""
