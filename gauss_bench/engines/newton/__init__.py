"""The adapter to Newton with its solver Kamino, on a processor. Its library has an environment of its own.

`world.py` builds a linkage in Newton, `kernels.py` keeps its machine code, `adapter.py` runs it.
"""
