"""MJX's functions, compiled by XLA for one processor core in double precision.

Machine code is kept in the cache of the user, as to compile takes half a minute of the processor. It depends only on the shape of a
model, its integrator and its solver: step size, masses, forces and softness are arguments, so that one compilation serves them all.
"""

import contextlib
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
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


@cache
def functions(jax: Any, mjx: Any) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the loop of steps and the terms at a state; JAX compiles each once for every shape of a model, at its first call.

    take_steps    model, state, number of steps -> state after them
    terms         model, state -> acceleration, mass matrix, forces, centres of mass, gaps
    """

    def take_steps(model: Any, state: Any, count: Any) -> Any:
        return jax.lax.fori_loop(0, count, lambda _, x: mjx.step(model, x), state)

    def terms(model: Any, state: Any) -> tuple[Any, ...]:
        x = mjx.forward(model, state)
        forces = x.qfrc_applied + x.qfrc_passive + x.qfrc_actuator - x.qfrc_bias
        return x.qacc, mjx.full_m(model, x), forces, x.xipos, x._impl.efc_pos

    return jax.jit(take_steps), jax.jit(terms)


class Device:
    """MuJoCo's compiled model on JAX's device, with the functions compiled for it.

    Attributes:
        rest: MJX's state at qpos0 and rest, with the forces `torque` (n,); every other state is a copy of it.
    """

    def __init__(self, libraries: Libraries, model: Any, torque: Array):
        self.array, self.mjx = libraries.jax.numpy.array, libraries.mjx
        self._take_steps, self._terms = functions(libraries.jax, libraries.mjx)
        self.set(model)
        rest = self.mjx.put_data(model, libraries.mujoco.MjData(model))
        self.rest: Any = rest.replace(qfrc_applied=self.array(torque))

    def set(self, model: Any) -> None:
        """Take the numbers of MuJoCo's model."""
        self.model: Any = self.mjx.put_model(model)

    def with_step(self, size: float) -> Any:
        """Return MJX's model with steps of `size` [s]."""
        return self.model.tree_replace({"opt.timestep": self.array(size)})

    def start(self, y: Array, dy: Array, t: float) -> Any:
        """Return MJX's state at a tree state y, dy (n,) and time t [s]."""
        return self.rest.replace(qpos=self.array(y), qvel=self.array(dy), time=self.array(t))

    def take_steps(self, model: Any, state: Any, count: int) -> Any:
        """Return MJX's state after `count` steps with one of the models of `with_step`."""
        return self._take_steps(model, state, count)

    def evaluate(self, y: Array, dy: Array) -> Evaluated:
        """Evaluate the terms at a tree state y, dy (n,)."""
        found = [np.array(x) for x in self._terms(self.model, self.start(y, dy, 0.0))]
        acceleration, mass, forces, centres, gaps = found
        return Evaluated(acceleration, mass, forces, centres, gaps.reshape(-1, 3))
