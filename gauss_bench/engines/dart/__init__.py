"""The adapter to DART, which has an environment of its own.

`translate.py` builds worlds, `messages.py` takes up what DART prints,
and `adapter.py` runs it.
"""
