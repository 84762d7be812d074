"""The truth: trajectories and accelerations more exact than what they judge, each with its own error bar.

Nothing here uses a formulation or an integrator under test.
"""
