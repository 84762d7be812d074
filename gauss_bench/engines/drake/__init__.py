"""The adapter to Drake (pydrake): its discrete plants, and its integrators of continuous plants. Drake has its own environment.

`translate.py` builds plants, `stepping.py` steps them, `adapter.py` is the engine, and `program.py` writes programs.
"""
