"""The adapter to Drake (pydrake), whose multibody plants take steps of their own or are integrated. It has an environment of its own.

`translate.py` builds plants; `adapter.py` runs them.
"""
