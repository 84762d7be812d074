"""MuJoCo's model of a linkage, for all engines that use such models.

`draft` builds the model, `forces` translates forces, `settings` sets the options of the compiled model, `drives` makes coordinates
follow motion laws, and `document` writes the model as MJCF. Here the library `mujoco` only compiles and reads models; the engines'
own folders step them.
"""
