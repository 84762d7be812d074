"""The adapter to MJX, an implementation of MuJoCo in JAX, which needs an environment of its own.

`xla.py` compiles MJX's functions to machine code, `adapter.py` runs them on the model of `engines/mjcf`, and `program.py` writes
programs.
"""
