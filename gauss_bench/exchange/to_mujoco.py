"""Export as a Python script for MuJoCo: the model as MJCF, the settings that MJCF cannot express, and a run."""

from xml.etree.ElementTree import indent, tostring

from gauss_bench.engines.base import Choice
from gauss_bench.engines.transcript import name_laws
from gauss_bench.engines.tree import turning
from gauss_bench.exchange.scripts import write_program
from gauss_bench.mechanism.model import Mechanism


def write(mechanism: Mechanism, choice: Choice, head: list[str]) -> str:
    """Return a Python script that simulates the mechanism in MuJoCo.

    Raises:
        RunFailure: MuJoCo cannot model the mechanism.
        ImportError: MuJoCo is not installed.
    """
    from gauss_bench.engines.mjcf.document import write_document
    from gauss_bench.engines.mujoco.adapter import Mujoco, MujocoModel

    built = MujocoModel(mechanism, choice)
    # edited: the script itself adds motion laws and scales MuJoCo's inverse weights, which a document cannot express
    root = write_document(built, edited=True).root
    indent(root)
    options, angles, laws = Mujoco.file.options(choice.settings), turning(built.tree), name_laws(mechanism)
    return write_program(
        "mujoco.py.jinja",
        mechanism,
        choice,
        [*head, f"Settings: {choice.settings}, {choice.integrator}. Bodies are links; connect constraints close the loops."],
        mjcf=tostring(root, encoding="unicode").splitlines(keepends=True),
        bodies=[built.model.body(k).name for k in built.bodies],
        angles=angles.constants[:-1],  # the last entry is the ground
        turns=angles.rows[:-1],
        inverse_weights=float(options["body_invweight0_factor"]),
        solref_in_steps=float(options["solref"][0]) if options["solref_unit"] == "step" else 0.0,
        # drives prescribe a joint coordinate; cylinders prescribe a length through an actuator, `motor`
        drives=[[x.at, x.armature, laws[id(x.law)]] for x in built.drives if x.motor is None],
        cylinders=[[x.at, x.motor, x.armature, laws[id(x.law)]] for x in built.drives if x.motor is not None],
    )
