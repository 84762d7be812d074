"""MuJoCo's model of a linkage, for all engines that use such models.

`draft` writes the model as MJCF, `forces` translates forces, `settings` sets the options of the compiled model, `drives` compiles
the model and makes coordinates follow motion laws, and `document` completes a draft so that it runs without this suite. The modules
here use the library `mujoco` only to compile models and evaluate states; the adapters in the folders of the engines run the models.
"""
