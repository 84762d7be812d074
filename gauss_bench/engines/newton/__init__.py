"""The adapter to Newton with its solver Kamino, run on the CPU. The library needs an environment of its own.

`world.py` builds a linkage in Newton, `kernels.py` keeps machine code, `adapter.py` runs the linkage, and `accelerations.py` finds
accelerations. `sample.py` is the linkage for which kernels are compiled.
"""
