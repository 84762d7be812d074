"""MJX's functions, compiled by XLA for one processor core in double precision.

Machine code is kept in the cache of the user, as to compile takes half a minute of the processor. It depends only on the shape of a
model, its integrator and its solver: step size, masses, forces and softness are arguments, so that one compilation serves them all.
"""

import contextlib
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gauss_bench.compiler.user_cache import is_trusted
from gauss_bench.terms import Array

ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
FOLDER = "jax"  # of machine code, in the folder of the user's cache
KEPT_ABOVE = 1.0  # [s] of compilation


@dataclass(frozen=True)
class Libraries:
    """The modules that the adapter needs."""

    jax: Any
    mujoco: Any
    mjx: Any


def load_libraries() -> Libraries:
    """Import JAX and MJX, in double precision on the processor; both settings must stand before the first array is made.

    Raises:
        ImportError: one is not installed.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if ONE_CORE not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {ONE_CORE}".strip()
    import jax

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    if folder := is_trusted():
        jax.config.update("jax_compilation_cache_dir", str(folder / FOLDER))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", KEPT_ABOVE)
    import mujoco

    with contextlib.redirect_stdout(io.StringIO()):  # it prints that Warp is missing, which only graphics cards need
        from mujoco import mjx
    return Libraries(jax, mujoco, mjx)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """MJX's terms at a tree state of n coordinates.

    Attributes:
        acceleration: (n,) of the tree coordinates.
        mass: (n, n); forces: (n,) all forces and velocity terms, without those of closures.
        centres: (bodies, 3) centres of mass [m]; gaps: (pins, 3) of the closures [m].
    """

    acceleration: Array
    mass: Array
    forces: Array
    centres: Array
    gaps: Array


class Device:
    """MuJoCo's compiled model on JAX's device, with the functions compiled for it.

    Attributes:
        data: MJX's state at qpos0 and rest, with the forces `torque` (n,); runs begin with a copy of it.
    """

    def __init__(self, libraries: Libraries, model: Any, torque: Array):
        self.jax, self.mjx = libraries.jax, libraries.mjx
        self.model: Any = self.mjx.put_model(model)
        self.data: Any = self.mjx.put_data(model, libraries.mujoco.MjData(model)).replace(qfrc_applied=self.jax.numpy.array(torque))
        self._loop: Any = None
        self._forward: Any = None

    def set(self, model: Any) -> None:
        """Take the numbers of MuJoCo's model anew; nothing is compiled again if only numbers changed."""
        self.model = self.mjx.put_model(model)

    def with_step(self, size: float) -> Any:
        """Return MJX's model with steps of `size` [s]."""
        return self.model.tree_replace({"opt.timestep": self.jax.numpy.array(size)})

    def start(self, y: Array, dy: Array, t: float) -> Any:
        """Return MJX's state at a tree state y, dy (n,) and time t [s]."""
        array = self.jax.numpy.array
        return self.data.replace(qpos=array(y), qvel=array(dy), time=array(float(t)))

    def compile_loop(self) -> None:
        """Compile the loop of steps, unless it is compiled already."""
        if self._loop is None:
            mjx, fori_loop = self.mjx, self.jax.lax.fori_loop

            def take_steps(model: Any, data: Any, count: Any) -> Any:
                return fori_loop(0, count, lambda _, state: mjx.step(model, state), data)

            self._loop = self.jax.jit(take_steps).lower(self.model, self.data, 1).compile()

    def take_steps(self, model: Any, data: Any, count: int) -> Any:
        """Return MJX's state after `count` steps."""
        return self._loop(model, data, count)

    def evaluate(self, y: Array, dy: Array) -> Evaluated:
        """Evaluate the terms at a tree state y, dy (n,), by code of its own, which contains no step."""
        data = self.start(y, dy, 0.0)
        if self._forward is None:
            mjx = self.mjx

            def terms(model: Any, data: Any) -> Sequence[Any]:
                x = mjx.forward(model, data)
                forces = x.qfrc_applied + x.qfrc_passive + x.qfrc_actuator - x.qfrc_bias
                return x.qacc, mjx.full_m(model, x), forces, x.xipos, x._impl.efc_pos

            self._forward = self.jax.jit(terms).lower(self.model, data).compile()
        acceleration, mass, forces, centres, gaps = (np.array(x) for x in self._forward(self.model, data))
        return Evaluated(acceleration, mass, forces, centres, gaps.reshape(-1, 3))
