"""Random hostile input: damaged linkage files, arguments, stiff motions, wrong motions, kills and many calls.

`python -m tests.fuzz` tries many of each, and the tests try a few.
"""
