"""Pinocchio: `tree` builds the model, `forces` computes the forces for which Pinocchio has no element, `adapter` runs the model.

`dynamics` calls Pinocchio's solver from Python, and `compiled` calls it from C++ (`loop.cpp`, which `build` compiles). `symbolic`
stands for Pinocchio's symbolic scalar, and `library_calls` times the library alone.
"""
