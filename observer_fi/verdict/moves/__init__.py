"""A move as a whole: the paths that it may have gone, what they may be called, a second fault behind the first."""
