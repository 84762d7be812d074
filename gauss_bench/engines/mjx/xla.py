"""MJX's functions, compiled by XLA for one processor core in double precision.

The machine code is stored in the user's cache, because its compilation takes half a minute. The code depends only on a model's
dimensions, integrator and solver. Step size, masses, forces and softness of closures are arguments of the compiled functions, so
one compilation serves for all their values.
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
STORED_ABOVE = 1.0  # [s] machine code is stored if its compilation took longer


@dataclass(frozen=True)
class Libraries:
    """The modules `jax`, `mujoco` and `mujoco.mjx`."""

    jax: Any
    mujoco: Any
    mjx: Any


def load_libraries() -> Libraries:
    """Import JAX and MJX, and set JAX to double precision on one core, which is possible only before its first array is made.

    Raises:
        ImportError: JAX, MuJoCo or MJX is not installed.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if ONE_CORE not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {ONE_CORE}".strip()
    import jax

    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    if folder := trusted_folder():  # the folder of the user's cache; None if other users could write into it
        jax.config.update("jax_compilation_cache_dir", str(folder / FOLDER))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", STORED_ABOVE)
    import mujoco

    with contextlib.redirect_stdout(io.StringIO()):  # MJX prints that Warp is missing, which only graphics cards need
        from mujoco import mjx
    return Libraries(jax, mujoco, mjx)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """MJX's terms of the equations of motion at a tree state of n coordinates.

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
def make_functions(jax: Any, mjx: Any, *, model_type: Any, state_type: Any) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the functions take_steps and terms for models and states of one structure; JAX compiles each on its first call.

    take_steps(model, state, number of steps) returns the state after the steps. terms(model, state) returns the fields of
    `Evaluated`.

    Both functions take a model and a state as lists of arrays, because JAX needs some milliseconds in every call to pass objects of
    MJX's own classes. Such an object is restored from its list and its structure.

    Args:
        model_type, state_type: structures (JAX's PyTreeDef) of MJX's model and state: names and order of their arrays.
    """
    flatten, unflatten, map_arrays = jax.tree_util.tree_leaves, jax.tree_util.tree_unflatten, jax.tree_util.tree_map

    def take_steps(model: list[Any], state: list[Any], count: Any) -> list[Any]:
        """Return the state, a list of arrays, after `count` steps."""
        mjx_model, start = unflatten(model_type, model), unflatten(state_type, state)

        def take_step(_: Any, old: Any) -> Any:
            """Return MJX's state after one step, with the number types of the old state."""
            # Trap: with tendons MJX returns integers of another size, and JAX's loop refuses a state whose types change
            return map_arrays(lambda new, before: new.astype(before.dtype), mjx.step(mjx_model, old), old)

        return list(flatten(jax.lax.fori_loop(0, count, take_step, start)))

    def terms(model: list[Any], state: list[Any]) -> tuple[Any, ...]:
        """Return the fields of `Evaluated`, in their order."""
        mjx_model = unflatten(model_type, model)
        data = mjx.forward(mjx_model, unflatten(state_type, state))
        forces = data.qfrc_applied + data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        # the gaps are the residuals of the only constraints, the closures; only this private field of MJX has them
        return data.qacc, mjx.full_m(mjx_model, data), forces, data.xipos, data._impl.efc_pos

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
        # a state whose arrays are replaced by their indices in the list of a state: it gives the indices of qpos and qvel
        self._state_type = self.trees.tree_structure(self.rest)
        indices = self.trees.tree_unflatten(self._state_type, range(self._state_type.num_leaves))
        self._tree_state_indices = indices.qpos, indices.qvel
        self.set(model)

    def _put(self, x: Any) -> Any:
        """Return numbers as an array that is committed to the device, which means that JAX may not move it to another device.

        Trap: `jax.numpy.array` makes arrays that are not committed. If a function gets such an array, JAX compiles the function a
        second time, and this would happen in a timed run.
        """
        return self.jax.device_put(np.asarray(x, dtype=float), self.jax.devices("cpu")[0])

    def set(self, model: Any) -> None:
        """Put the numbers of MuJoCo's model on the device, and choose the compiled functions for its structure."""
        self.model: Any = self.mjx.put_model(model)
        model_type = self.trees.tree_structure(self.model)
        self._take_steps, self._terms = make_functions(self.jax, self.mjx, model_type=model_type, state_type=self._state_type)

    def with_step(self, size: float) -> list[Any]:
        """Return MJX's model with steps of `size` [s], as a list of arrays."""
        return list(self.trees.tree_leaves(self.model.tree_replace({"opt.timestep": self._put(size)})))

    def start(self, y: Array, dy: Array, t: float) -> list[Any]:
        """Return MJX's state at a tree state y, dy (n,) and time t [s], as a list of arrays."""
        state = self.rest.replace(qpos=self._put(y), qvel=self._put(dy), time=self._put(t))
        return list(self.trees.tree_leaves(state))

    def take_steps(self, model: list[Any], state: list[Any], count: int) -> list[Any]:
        """Return MJX's state after `count` steps with a model of `with_step`; JAX returns before it has finished the steps."""
        return list(self._take_steps(model, state, count))

    def tree_state(self, state: list[Any]) -> tuple[Any, Any]:
        """Return y and dy (n,) of a state, as JAX arrays; reading their values waits until JAX has computed them."""
        y, dy = self._tree_state_indices
        return state[y], state[dy]

    def evaluate(self, y: Array, dy: Array) -> Evaluated:
        """Evaluate the terms of the equations of motion at a tree state y, dy (n,): joint coordinates and their rates."""
        model = list(self.trees.tree_leaves(self.model))
        acceleration, mass, forces, centres, gaps = (np.array(x) for x in self._terms(model, self.start(y, dy, 0.0)))
        return Evaluated(acceleration, mass, forces, centres, gaps.reshape(-1, 3))
