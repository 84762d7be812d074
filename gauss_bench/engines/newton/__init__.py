"""The adapter to Newton with its solver Kamino, run on the CPU. The library needs an environment of its own.

`world.py` builds a linkage in Newton, `kernels.py` stores machine code, `adapter.py` runs the linkage, `accelerations.py` finds
accelerations, and `sample.py` has the linkage for which kernels are compiled.
"""
