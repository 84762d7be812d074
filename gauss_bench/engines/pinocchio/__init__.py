"""Pinocchio: `tree` builds the model, and `adapter` runs it.

`dynamics` computes the forces for which Pinocchio has no element and calls its solver from Python; `compiled` calls it from C++
(`loop.cpp`, which `build` compiles). `symbolic` stands for Pinocchio's symbolic scalar, and `library_calls` times the library
alone.
"""
