"""MJX, which is MuJoCo's equations in JAX. Its library has an environment of its own.

`xla.py` compiles the model of `engines/mjcf` to machine code; `adapter.py` runs it.
"""
