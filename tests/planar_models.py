"""Random planar MJCF: trees of hinges, slides and free bodies with springs, motors and servos, in any plane, with any loops."""

import numpy as np
from numpy.random import Generator

PLANES = ([[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 1]], [[0, 0, -1], [0, 1, 0]])  # x and y of the model
SHAPE = '<geom type="box" size=".1 .05 .02" euler="{}" pos="{}" contype="0" conaffinity="0"/>'


def n(*x: float) -> str:
    return " ".join(repr(float(v)) for v in x)


def random_model(r: Generator, loops: int = 0) -> str:
    """Return a document with the keyframe `start`; with loops it starts at rest at its reference, where the loops are closed."""
    count = int(r.integers(2 if loops else 1, 5))
    parents = [int(r.integers(-1, k)) if k else -1 for k in range(count)]
    bodies, joints = zip(*(_body(r, k, parents[k], loops == 0) for k in range(count)), strict=True)
    names = [name for some in joints for name in some]

    def text(k: int) -> str:
        inner = "".join(text(child) for child in range(count) if parents[child] == k)
        return inner if k < 0 else bodies[k].replace("</body>", f"{inner}</body>")

    whole = text(-1)
    actuators = _actuators(r, names, count)
    control = f'ctrl="{n(*r.normal(size=len(actuators)))}"' if actuators else ""
    state = "" if loops else f'qpos="{n(*r.normal(size=len(names)) * 0.6)}" qvel="{n(*r.normal(size=len(names)))}"'
    closed = "".join(_closure(r, count) for _ in range(loops))
    x, y = PLANES[r.integers(len(PLANES))] if r.random() < 0.6 else np.linalg.qr(r.normal(size=(3, 2)))[0].T
    gravity = r.normal() * 7 * np.array(x) + r.normal() * 7 * np.array(y)
    rig = f'<body name="rig" pos="{n(*r.normal(size=3))}" xyaxes="{n(*x)} {n(*y)}"><site name="w" pos=".1 .2 0"/>{whole}</body>'
    return f"""<mujoco><compiler angle="radian"/><option gravity="{n(*gravity)}"/><worldbody>{rig}</worldbody>
        <equality>{closed}</equality><actuator>{"".join(actuators)}</actuator>
        <keyframe><key name="start" {state} {control}/></keyframe></mujoco>"""


def _body(r: Generator, k: int, parent: int, may_be_free: bool) -> tuple[str, list[str]]:
    angle, turn = r.uniform(0, 6.28, 2)
    spring = f'stiffness="{n(r.uniform(0, 3))}" springref="{n(r.normal())}" ' if r.random() < 0.6 else ""
    spring += f'damping="{n(r.uniform(0, 1))}"' if r.random() < 0.6 else ""
    along = f'axis="{n(np.cos(angle), np.sin(angle), 0)}"'
    kind = "free" if may_be_free and parent < 0 and r.random() < 0.2 else "slide" if r.random() < 0.3 else "hinge"
    if kind == "hinge":
        pin = f'axis="0 0 {n(r.choice([-1, 1]))}" pos="{n(*r.normal(size=2) * 0.1, r.normal())}"'
        pin += f' armature="{n(r.uniform(0, 0.1))}"' if parent < 0 else ""
        joints, names = f'<joint name="j{k}" {pin} ref="{n(r.normal() / 2)}" {spring}/>', [f"j{k}"]
    elif kind == "slide":
        joints, names = f'<joint name="j{k}" type="slide" {along} ref="{n(r.normal() / 2)}" {spring}/>', [f"j{k}"]
    else:
        names = [f"j{k}{x}" for x in "xyt"]
        across = f'axis="{n(-np.sin(angle), np.cos(angle), 0)}"'
        joints = f'<joint name="{names[0]}" type="slide" {along} {spring}/><joint name="{names[1]}" type="slide" {across}/>'
        joints += f'<joint name="{names[2]}" axis="0 0 -1" pos="{n(*r.normal(size=2) * 0.1, 0)}" {spring}/>'
    shape = SHAPE.format(n(*r.normal(size=3)), n(*r.normal(size=3) * 0.1))
    place = f'pos="{n(*r.normal(size=2) * 0.3, r.normal() * 0.2)}" quat="{n(np.cos(turn / 2), 0, 0, np.sin(turn / 2))}"'
    site = f'<site name="s{k}" pos="{n(*r.normal(size=2) * 0.2, 0)}"/>'
    return f'<body name="b{k}" {place}>{joints}{shape}{site}</body>', names


def _actuators(r: Generator, joints: list[str], count: int) -> list[str]:
    found = [f'<motor name="m{j}" joint="{j}" gear="{n(r.normal())}"/>' for j in joints if r.random() < 0.4]
    servo = '<position name="p{0}" joint="{0}" kp="{1}" kv="{2}" gear="{3}"/>'
    found += [servo.format(j, n(r.uniform(0, 2)), n(r.uniform(0, 1)), n(r.normal())) for j in joints if r.random() < 0.3]
    push = '<motor site="s{0}" gear="{1} 0 0 0 0"/>'
    found += [push.format(k, n(*r.normal(size=2))) for k in range(count) if r.random() < 0.3]
    push = '<motor site="s{0}" refsite="w" gear="{1} 0 0 0 0"/>'
    return found + [push.format(k, n(*r.normal(size=2))) for k in range(count) if r.random() < 0.2]


def _closure(r: Generator, count: int) -> str:
    a, b = r.choice(np.arange(-1, count), 2, replace=False)
    a, b = (b, a) if a < 0 else (a, b)
    other = f' body2="b{b}"' if b >= 0 else ""
    return f'<connect body1="b{a}"{other} anchor="{n(*r.normal(size=2) * 0.2, 0)}"/>'
