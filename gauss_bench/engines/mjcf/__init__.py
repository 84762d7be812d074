"""MuJoCo's model of a linkage, for every engine that takes one: `draft` builds it, with an element for each force by `forces`.

`settings` sets the options of the compiled model, `drives` what follows a motion law; `document` writes the model as MJCF. The
library `mujoco` is used here for the format alone: it compiles, reads and writes models. An engine's own room steps them.
"""
