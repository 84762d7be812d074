"""PyBullet: one call of changeDynamics sends mass and inertia of a link to the base, and frees it. Needs pybullet alone.

python bullet_change_dynamics.py    prints what each call did to a pendulum whose base is fixed
"""

import pybullet

FURTHER = ("nothing", "jointDamping", "lateralFriction", "linearDamping", "angularDamping", "maxJointVelocity", "collisionMargin")


def pendulum() -> int:
    """Add a link that hangs in a hinge of a fixed base, with no collision shape, and return Bullet's number of it."""
    return pybullet.createMultiBody(
        baseMass=0.0,
        linkMasses=[1.0],
        linkCollisionShapeIndices=[-1],
        linkVisualShapeIndices=[-1],
        linkPositions=[[0.0, 0.0, 0.0]],
        linkOrientations=[[0.0, 0.0, 0.0, 1.0]],
        linkInertialFramePositions=[[0.5, 0.0, 0.0]],
        linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]],
        linkParentIndices=[0],
        linkJointTypes=[pybullet.JOINT_REVOLUTE],
        linkJointAxis=[[0.0, 1.0, 0.0]],
    )


def main() -> None:
    from importlib.metadata import version

    print("pybullet", version("pybullet"))
    print(f"{'set in the same call':22}{'mass of link':14}{'mass of base':14}base after 1 s")
    pybullet.connect(pybullet.DIRECT)
    for keyword in FURTHER:
        pybullet.resetSimulation()
        pybullet.setGravity(0.0, 0.0, -10.0)
        body = pendulum()
        further = {} if keyword == "nothing" else {keyword: 0.5}
        pybullet.changeDynamics(body, 0, mass=2.0, localInertiaDiagonal=[0.1, 0.1, 0.1], **further)
        link, base = (pybullet.getDynamicsInfo(body, k)[0] for k in (0, -1))
        for _ in range(240):  # steps of 1/240 s
            pybullet.stepSimulation()
        (_, _, z), _ = pybullet.getBasePositionAndOrientation(body)
        print(f"{keyword:22}{link:<14g}{base:<14g}z = {z:.2f} m")


if __name__ == "__main__":
    main()
