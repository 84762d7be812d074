"""MJX's functions, compiled by XLA for one processor core in double precision.

The machine code is kept in the user's cache, because its compilation takes half a minute. The machine code depends only on the
dimensions of a model, its integrator and its solver. Step size, masses, forces and softness of closures are arguments of the
compiled functions, so one compilation serves for all their values.
"""

import contextlib
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from gauss_bench.compiler.user_cache import trusted_folder
from gauss_bench.terms import Array

ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
FOLDER = "jax"  # folder of machine code, in the user's cache
KEPT_ABOVE = 1.0  # [s] machine code is kept if its compilation took longer


@dataclass(frozen=True)
class Libraries:
    """The modules `jax`, `mujoco` and `mujoco.mjx`."""

    jax: Any
    mujoco: Any
    mjx: Any


def load_libraries() -> Libraries:
    """Import JAX and MJX, in double precision on the processor; both must be set before JAX makes its first array.

    Raises:
        ImportError: JAX, MuJoCo or MJX is not installed.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if ONE_CORE not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {ONE_CORE}".strip()
    import jax

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    if folder := trusted_folder():  # the folder of the user's cache; None if others could put code into it
        jax.config.update("jax_compilation_cache_dir", str(folder / FOLDER))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", KEPT_ABOVE)
    import mujoco

    with contextlib.redirect_stdout(io.StringIO()):  # MJX prints that Warp is missing, which only graphics cards need
        from mujoco import mjx
    return Libraries(jax, mujoco, mjx)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The terms of the equations of motion that MJX computes at a tree state of n coordinates.

    Attributes:
        acceleration: (n,) accelerations of the tree coordinates.
        mass: (n, n) mass matrix.
        forces: (n,) all forces and velocity terms, without the forces of closures.
        centres: (bodies, 3) centres of mass [m].
        gaps: (pins, 3) point a minus point b of each closure [m].
    """

    acceleration: Array
    mass: Array
    forces: Array
    centres: Array
    gaps: Array


@cache
def functions(jax: Any, mjx: Any, *, of_model: Any, of_state: Any) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the two functions take_steps and terms for models of one structure; JAX compiles a function on its first call.

    take_steps(model, state, number of steps) returns the state after the steps. terms(model, state) returns the fields of
    `Evaluated`: acceleration, mass matrix, forces, centres of mass and gaps.

    Both functions take a model and a state as lists of arrays, because JAX needs some milliseconds in every call to pass objects of
    MJX's own classes. A list has the arrays of such an object in a fixed order. The object is restored from the list and from the
    object's structure.

    Args:
        of_model, of_state: structures of MJX's model and state, without their numbers.
    """
    flatten, unflatten, map_arrays = jax.tree_util.tree_leaves, jax.tree_util.tree_unflatten, jax.tree_util.tree_map

    def take_steps(model: list[Any], state: list[Any], count: Any) -> list[Any]:
        """Return the state, a list of arrays, after `count` steps."""
        mjx_model, start = unflatten(of_model, model), unflatten(of_state, state)

        def take_step(_: Any, old: Any) -> Any:
            """Return MJX's state after one step, with the number types of the old state."""
            # Trap: with tendons MJX returns integers of another size, and JAX's loop refuses a state whose types change
            return map_arrays(lambda new, kept: new.astype(kept.dtype), mjx.step(mjx_model, old), old)

        return list(flatten(jax.lax.fori_loop(0, count, take_step, start)))

    def terms(model: list[Any], state: list[Any]) -> tuple[Any, ...]:
        """Return the fields of `Evaluated`: accelerations, mass matrix, forces, centres of mass, gaps of closures."""
        mjx_model = unflatten(of_model, model)
        x = mjx.forward(mjx_model, unflatten(of_state, state))
        forces = x.qfrc_applied + x.qfrc_passive + x.qfrc_actuator - x.qfrc_bias
        # the gaps are the residuals of the only constraints, the closures; MJX shows them in this private field alone
        return x.qacc, mjx.full_m(mjx_model, x), forces, x.xipos, x._impl.efc_pos

    return jax.jit(take_steps), jax.jit(terms)


class Device:
    """MuJoCo's compiled model on JAX's device, with its compiled functions; its methods pass models and states as lists of arrays.

    Attributes:
        rest: MJX's state at qpos0 and at rest, with the constant forces `torque` (n,); all other states are changed copies of it.
    """

    def __init__(self, libraries: Libraries, model: Any, torque: Array):
        """Put a compiled model with constant forces `torque` (n,) on the device."""
        self.jax, self.mjx = libraries.jax, libraries.mjx
        self.trees = self.jax.tree_util
        rest = self.mjx.put_data(model, libraries.mujoco.MjData(model))
        self.rest: Any = rest.replace(qfrc_applied=self._put(torque))
        # a state whose leaves are their own indices gives the indices of qpos and qvel in the list of a state
        structure = self.trees.tree_structure(self.rest)
        indices = self.trees.tree_unflatten(structure, range(structure.num_leaves))
        self._places = indices.qpos, indices.qvel
        self.set(model)

    def _put(self, x: Any) -> Any:
        """Return numbers as an array that is committed to the device, which means that JAX may not move the array to another one.

        Trap: `jax.numpy.array` makes arrays that are not committed. If a function gets an array that is not committed, JAX compiles
        the function a second time, and this would happen in a timed run.
        """
        return self.jax.device_put(np.asarray(x, dtype=float), self.jax.devices("cpu")[0])

    def set(self, model: Any) -> None:
        """Put the numbers of MuJoCo's model on the device, and choose the compiled functions for its structure."""
        self.model: Any = self.mjx.put_model(model)
        # all states of MJX have the structure of `rest`, the state at rest
        of_model, of_state = self.trees.tree_structure(self.model), self.trees.tree_structure(self.rest)
        self._take_steps, self._terms = functions(self.jax, self.mjx, of_model=of_model, of_state=of_state)

    def with_step(self, size: float) -> list[Any]:
        """Return MJX's model with steps of `size` [s]."""
        return list(self.trees.tree_leaves(self.model.tree_replace({"opt.timestep": self._put(size)})))

    def start(self, y: Array, dy: Array, t: float) -> list[Any]:
        """Return MJX's state at a tree state y, dy (n,) and time t [s]."""
        state = self.rest.replace(qpos=self._put(y), qvel=self._put(dy), time=self._put(t))
        return list(self.trees.tree_leaves(state))

    def take_steps(self, model: list[Any], state: list[Any], count: int) -> list[Any]:
        """Return MJX's state after `count` steps of a model that `with_step` made; JAX returns before it has finished the steps."""
        return list(self._take_steps(model, state, count))

    def tree_state(self, state: list[Any]) -> tuple[Any, Any]:
        """Return y and dy (n,) of a state, as JAX arrays; reading their values waits until JAX has computed them."""
        y, dy = self._places
        return state[y], state[dy]

    def evaluate(self, y: Array, dy: Array) -> Evaluated:
        """Evaluate the terms of the equations of motion at a tree state y, dy (n,): joint coordinates and their rates.

        The compiled function takes the model as a list of JAX arrays.
        """
        model = list(self.trees.tree_leaves(self.model))
        acceleration, mass, forces, centres, gaps = (np.array(x) for x in self._terms(model, self.start(y, dy, 0.0)))
        return Evaluated(acceleration, mass, forces, centres, gaps.reshape(-1, 3))
