"""Native kernels: a linkage becomes straight-line code for accelerations and corrections, compiled for this machine."""
