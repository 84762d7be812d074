"""The adapter to MJX, which is MuJoCo's equations in JAX. MJX needs an environment of its own.

`xla.py` compiles MJX's functions to machine code, `adapter.py` runs them on the model of `engines/mjcf`, and `program.py` writes
programs.
"""
