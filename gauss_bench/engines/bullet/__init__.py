"""The adapter to Bullet, through the Python package PyBullet, whose wheel is made for one version of Python.

`world.py` builds a linkage in Bullet, `translate.py` sorts its forces, `accelerations.py` finds accelerations from the velocities
before and after a step, `adapter.py` runs the linkage, and `program.py` writes programs.
"""
