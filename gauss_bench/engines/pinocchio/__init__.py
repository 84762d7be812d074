"""Pinocchio: `tree` builds the model, `forces` computes the forces that Pinocchio does not have, `adapter` runs the model.

`dynamics` calls Pinocchio's solver from Python, `compiled` calls it from C++ (`loop.cpp`, built by `build`). `library_calls` times
the library alone.
"""
