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


@dataclass(frozen=True)
class Shapes:
    """The structure of MJX's model and state without their numbers, by which compiled functions are kept."""

    model: Any
    state: Any


@cache
def functions(jax: Any, mjx: Any, shapes: Shapes) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return two functions of the numbers of a model and a state, each a list of arrays; JAX compiles each at its first call.

        take_steps    model, state, number of steps -> state after them
        terms         model, state -> acceleration, mass matrix, forces, centres of mass, gaps

    Lists are passed because MJX's own classes take some milliseconds to pass, at every call.
    """
    flatten, unflatten, over = jax.tree_util.tree_leaves, jax.tree_util.tree_unflatten, jax.tree_util.tree_map

    def take_steps(model: list[Any], state: list[Any], count: Any) -> list[Any]:
        whole, start = unflatten(shapes.model, model), unflatten(shapes.state, state)

        def take_step(_: Any, old: Any) -> Any:
            # Trap: where there are tendons MJX returns integers of another size, and JAX's loop refuses a state that changes
            return over(lambda new, kept: new.astype(kept.dtype), mjx.step(whole, old), old)

        return list(flatten(jax.lax.fori_loop(0, count, take_step, start)))

    def terms(model: list[Any], state: list[Any]) -> tuple[Any, ...]:
        whole = unflatten(shapes.model, model)
        x = mjx.forward(whole, unflatten(shapes.state, state))
        forces = x.qfrc_applied + x.qfrc_passive + x.qfrc_actuator - x.qfrc_bias
        return x.qacc, mjx.full_m(whole, x), forces, x.xipos, x._impl.efc_pos

    return jax.jit(take_steps), jax.jit(terms)


class Device:
    """MuJoCo's compiled model on JAX's device, with the functions compiled for it; models and states are lists of arrays.

    Attributes:
        rest: MJX's state at qpos0 and rest, with the forces `torque` (n,); every other state is a copy of it.
    """

    def __init__(self, libraries: Libraries, model: Any, torque: Array):
        self.jax, self.mjx = libraries.jax, libraries.mjx
        self.trees = self.jax.tree_util
        rest = self.mjx.put_data(model, libraries.mujoco.MjData(model))
        self.rest: Any = rest.replace(qfrc_applied=self._put(torque))
        count = self.trees.tree_structure(self.rest).num_leaves
        places = self.trees.tree_unflatten(self.trees.tree_structure(self.rest), range(count))
        self._places = places.qpos, places.qvel  # in the list of a state
        self.set(model)

    def _put(self, x: Any) -> Any:
        """Return numbers as an array that is bound to the device.

        Trap: for an array that is not bound, as `jax.numpy.array` makes it, JAX compiles everything a second time, inside a run.
        """
        return self.jax.device_put(np.asarray(x, dtype=float), self.jax.devices("cpu")[0])

    def set(self, model: Any) -> None:
        """Take the numbers of MuJoCo's model, and the functions for its shape."""
        self.model: Any = self.mjx.put_model(model)
        shapes = Shapes(self.trees.tree_structure(self.model), self.trees.tree_structure(self.rest))
        self._take_steps, self._terms = functions(self.jax, self.mjx, shapes)

    def with_step(self, size: float) -> list[Any]:
        """Return MJX's model with steps of `size` [s]."""
        return list(self.trees.tree_leaves(self.model.tree_replace({"opt.timestep": self._put(size)})))

    def start(self, y: Array, dy: Array, t: float) -> list[Any]:
        """Return MJX's state at a tree state y, dy (n,) and time t [s]."""
        state = self.rest.replace(qpos=self._put(y), qvel=self._put(dy), time=self._put(t))
        return list(self.trees.tree_leaves(state))

    def take_steps(self, model: list[Any], state: list[Any], count: int) -> list[Any]:
        """Return MJX's state after `count` steps with one of the models of `with_step`; JAX returns before it has computed."""
        return list(self._take_steps(model, state, count))

    def tree_state(self, state: list[Any]) -> tuple[Any, Any]:
        """Return y and dy (n,) of a state; to read their numbers is to wait for them."""
        y, dy = self._places
        return state[y], state[dy]

    def evaluate(self, y: Array, dy: Array) -> Evaluated:
        """Evaluate the terms at a tree state y, dy (n,)."""
        model = list(self.trees.tree_leaves(self.model))
        acceleration, mass, forces, centres, gaps = (np.array(x) for x in self._terms(model, self.start(y, dy, 0.0)))
        return Evaluated(acceleration, mass, forces, centres, gaps.reshape(-1, 3))
