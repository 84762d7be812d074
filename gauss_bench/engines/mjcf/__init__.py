"""MuJoCo's model of a linkage, for all engines that use such models.

`draft` writes the model as MJCF, `forces` translates forces, `settings` sets the options of the compiled model, `drives` compiles
the model and makes coordinates follow motion laws, and `document` adds to a draft what is needed to run it without this suite. The
modules here use the library `mujoco` only to compile and read models; the adapters in the folders of the engines run them.
"""
