"""The adapter to Drake (pydrake): its discrete plants, and its integrators of continuous ones. It has an environment of its own.

`translate.py` builds plants, `stepping.py` steps them; `adapter.py` is the engine.
"""
