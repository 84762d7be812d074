"""MuJoCo: `adapter` runs the model of `engines/mjcf`, and `own_model` runs the model of a user's file.

`compiled` compiles MJCF files of users. `library_calls` times the library alone.
"""
