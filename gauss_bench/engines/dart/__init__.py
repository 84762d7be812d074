"""The adapter to DART, which needs an environment of its own.

`translate.py` builds worlds, `adapter.py` runs them, `messages.py` catches the messages that DART prints, and `program.py` writes
programs.
"""
