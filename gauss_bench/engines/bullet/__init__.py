"""The adapter to Bullet, through the Python package PyBullet.

PyBullet's wheel is large and made for one version of Python, so the engine has its own Python environment. `translate.py` refuses
linkages that Bullet cannot model, and sorts forces. `joints.py` and `bodies.py` build a linkage in Bullet, and their common base
class is in `world.py`. `accelerations.py` computes accelerations from the velocities before and after a step. `adapter.py` runs the
linkage, and `program.py` writes programs.
"""
