"""The adapter to Bullet, through PyBullet. Its wheel is large and made for one version of Python, so it has its own environment.

`translate.py` refuses linkages and sorts forces; `joints.py` and `bodies.py` build a linkage, with `world.py` as their base;
`accelerations.py` finds accelerations from steps; `adapter.py` runs the linkage; `program.py` writes programs.
"""
