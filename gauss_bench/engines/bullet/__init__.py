"""The adapter to Bullet, through PyBullet. Its wheel is large and for one Python alone, so it has an environment.

`translate.py` tells what Bullet is given or refused; `joints.py` and `bodies.py` build it in a `world.py`; `accelerations.py` finds
the accelerations that steps imply; `adapter.py` runs it.
"""
