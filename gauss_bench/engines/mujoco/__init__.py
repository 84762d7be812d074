"""MuJoCo: `adapter` runs the model of `engines/mjcf`, `own_model` that of a user's file.

`compiled` reads documents of others. `library_calls` times the library alone.
"""
