"""Reasons for which a report is refused."""


class NoRun(ValueError):
    """A folder that holds no run."""
