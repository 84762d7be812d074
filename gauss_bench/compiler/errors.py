"""The error of this room."""


class KernelError(ValueError):
    """A linkage that cannot be turned into a kernel, or a kernel that fails its own check; the message gives the reason."""
