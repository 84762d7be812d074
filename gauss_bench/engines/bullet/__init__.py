"""The adapter to Bullet, through PyBullet. Its wheel is large, so it has an environment.

`translate.py` decides what Bullet can be given; `world.py` builds it in Bullet; `adapter.py` runs it.
"""
