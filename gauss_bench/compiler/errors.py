"""The error that the compiler raises."""


class KernelError(ValueError):
    """Raised if no kernel can be generated for a linkage, or if a kernel fails its own check; the message gives the reason."""
