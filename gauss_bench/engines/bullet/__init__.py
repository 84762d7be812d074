"""The adapter to Bullet, through the Python package PyBullet, whose wheel needs CPython 3.11.

`world.py` builds a linkage in Bullet, `translate.py` computes the forces on it, `accelerations.py` finds accelerations from the
velocities before and after a step, `adapter.py` runs the linkage, and `program.py` writes programs.
"""
