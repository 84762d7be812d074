"""Hostile inputs by lot: linkage files that were damaged, and lists of arguments that nobody would mean.

`python -m tests.fuzz --files 20000 --lists 3000 --seed 1` throws them at the command line's own function and tells every one that
ends otherwise than documented: with a traceback, with an exit code that is none of ours, or later than a refusal may take.
"""
