"""What a report can be refused for."""


class NoRun(ValueError):
    """A folder that holds no run."""
