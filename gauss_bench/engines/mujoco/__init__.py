"""MuJoCo: `adapter` runs a mechanism, `draft` is its model, `forces` the form that MuJoCo has for each force.

`library_calls` asks the library alone.
"""
