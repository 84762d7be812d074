"""The adapter to DART, which has an environment of its own.

`translate.py` builds worlds, `given.py` computes the forces that DART has no element for, `messages.py` takes up what DART prints,
and `adapter.py` runs it.
"""
