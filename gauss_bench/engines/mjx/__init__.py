"""The adapter to MJX, which is MuJoCo's equations in JAX. MJX needs an environment of its own.

`compiled.py` compiles the model of `engines/mjcf` by MuJoCo, `xla.py` compiles MJX's functions to machine code, `adapter.py` runs
them, and `program.py` writes programs.
"""
