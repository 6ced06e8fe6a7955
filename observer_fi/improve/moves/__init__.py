"""The problem of moves that are simulated."""
