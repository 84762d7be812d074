"""MuJoCo's model of a linkage, for all engines that use such models.

`draft` builds the model, `forces` translates forces, `settings` sets the options of the compiled model, `drives` compiles the model
and makes coordinates follow motion laws, and `document` writes the model as MJCF. The modules here use the library `mujoco` only to
compile and read models; the adapters in the folders of the engines run them.
"""
