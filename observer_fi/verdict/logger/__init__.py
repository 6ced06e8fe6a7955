"""What a logger does to its readings that only a motion shows: filters before them."""
