"""Errors that are a user's to mend: their message is the one line that a command prints."""


class InvalidLogError(ValueError):
    """A log that cannot be used. The message is the one line a user sees: file, row, column, what is wrong, what to do."""


class UsageError(ValueError):
    """A command, rig or map that cannot be used. The message is the one line a user sees."""
