"""Pinocchio: `tree` builds the model, and `adapter` runs it.

`dynamics` computes the forces for which Pinocchio has no element, and calls Pinocchio's solver from Python; `compiled` calls the
solver from C++ (`loop.cpp`, which `build` compiles). `symbolic` says why symbolic scalars are not used, and `library_calls` times
the library alone.
"""
