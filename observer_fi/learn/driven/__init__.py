"""Rigs whose servo nobody knows: constants from readings alone."""
