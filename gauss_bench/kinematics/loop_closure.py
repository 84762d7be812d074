"""Compute the motion of a linkage that follows its inputs, by closing its loops.

A state x has TU unknown variables, then TK inputs, as in `LoopEquations`. Between two sample times all inputs change in proportion.
A step is halved until the new state belongs to the same assembly by three tests: the predicted change of every angle is small,
Newton's method converges near this second-order prediction, and det(J^T J_next) > 0 for the Jacobians at both states (for a square
J: its determinant keeps its sign). The motion ends where even the shortest step fails: at a limit, beyond which the loops cannot be
closed, or at a singular position, where they can be closed in more than one way.

Source: Wang et al. (2010), fig. 4.
"""

from typing import NamedTuple

import numpy as np

from gauss_bench.kinematics.loop_equations import REGULAR, LoopEquations, Stopped
from gauss_bench.kinematics.motion import LimitOfMotion, Motion, SingularPosition, describe_drivers
from gauss_bench.mechanism.close import walk
from gauss_bench.mechanism.model import Mechanism
from gauss_bench.terms import Array, largest

LARGEST_TURN = 0.3  # [rad] largest turn of a link in one step: far less than between two assemblies, except near singular positions
LARGEST_MISS = 0.05  # [rad] largest distance of an angle from its prediction, whose error is of the order of the cube of the turn
SMALLEST_PART = 1e-10  # [rad, m] shortest step of the inputs: the accuracy to which a limit is found
BEYOND = 1e-3  # [rad, m] distance beyond the end of a motion: if the loops can be closed there, the end is no limit


class _State(NamedTuple):
    """A closed state x (TU + TK,), the Jacobian J (2L, TU) of the equations of the L loops, and the number of Newton steps to x."""

    x: Array
    J: Array
    steps: int


class _End(Stopped):
    """The motion cannot be followed beyond the state x, even with the shortest step."""

    def __init__(self, text: str, singular: bool, x: Array):
        """`singular` is True near a singular position, and False at a limit of the motion."""
        super().__init__(text, singular)
        self.x = x


def loop_motion(mechanism: Mechanism, times: Array) -> Motion:
    """Compute the motion at times (k,) [s] of a linkage with as many drivers, its inputs, as degrees of freedom.

    The first sample is reached from q0, so that angles are continuous from there. An open chain has no loops, and all its
    coordinates are inputs.

    Raises:
        ValueError: the drivers do not fit the linkage, as for LoopEquations.
        LimitOfMotion: an input leads beyond a limit of motion, where the loops cannot be closed.
        SingularPosition: the Jacobian loses rank on the way.
    """
    equations = LoopEquations(mechanism)
    times = np.asarray(times, dtype=float)
    goals, *rates = equations.input_levels(times)
    states: list[_State] = []
    x = equations.start()
    try:
        state = _State(*equations.close(x))
        for goal in goals:
            state = _follow(equations, state, goal)
            x = state.x
            # near a singular position rates are lost while positions can still be found
            equations.check_rank(state.J, REGULAR)
            states.append(state)
    except Stopped as stopped:
        end = stopped if isinstance(stopped, _End) else _End(f"singular position, {stopped}", True, x)
        reached = _motion(equations, states, rates)
        values, time = equations.input_values(end.x), float(times[len(states)])
        kind = SingularPosition if end.singular else LimitOfMotion
        text = f"{mechanism.name} stops at {describe_drivers(mechanism, values)} on the way to t = {time:.6g} s: {end}"
        raise kind(text, values, time, reached) from end
    return _motion(equations, states, rates)


def _follow(equations: LoopEquations, state: _State, goal: Array) -> _State:
    """Return the state with closed loops at the inputs `goal` (TK,), reached from `state` in steps.

    Raises:
        _End: the motion ends before, even with the shortest step.
    """
    start, steps = state.x, 0
    inputs = start[len(equations.unknown) :]  # values at the start
    change = goal - inputs
    size = largest(change)

    def advance(share: float) -> None:
        """Move the inputs to `inputs` + `share` * `change`."""
        nonlocal state, steps
        # at the end of the change the inputs are the goal itself: the sum would be rounded
        state = _advance(equations, state, goal if share == 1.0 else inputs + share * change)
        steps += state.steps

    if size:
        try:
            walk(advance, SMALLEST_PART / size)  # the shortest step, as a share of the whole change
        except Stopped as error:
            raise _explain_end(equations, start, state, change / size, error) from error
    return state._replace(steps=steps)


def _advance(equations: LoopEquations, state: _State, target: Array) -> _State:
    """Return the state with closed loops at the inputs `target` (TK,), in the same assembly as `state`.

    Raises:
        Stopped: the step is too long, or leads to no regular position.
    """
    unknowns, x = len(equations.unknown), state.x
    # prediction of second order: derivatives of x by a parameter from 0 to 1, with which the inputs change linearly
    slope, curvature = equations.rates(x, target - x[unknowns:], np.zeros_like(target))
    guess = x + slope + curvature / 2
    guess[unknowns:] = target
    angles = equations.is_angle
    if not largest((guess - x)[angles]) < LARGEST_TURN:
        raise Stopped("the angles turn too fast", singular=False)
    closed, J, steps = equations.close(guess)
    if not largest((closed - guess)[angles]) < LARGEST_MISS:
        raise Stopped("the position is far from the prediction", singular=False)
    # the determinant is not positive if J has passed a singular position, beyond which lies another assembly
    if unknowns and np.linalg.slogdet(state.J.T @ J)[0] <= 0:
        raise Stopped("the Jacobian changes its orientation", singular=True)
    return _State(closed, J, steps)


def _explain_end(equations: LoopEquations, start: Array, last: _State, direction: Array, failure: Stopped) -> _End:
    """Return the exception that tells why a motion ends after the state `last`.

    The end is a singular position if the Jacobian loses rank there, or if the loops can be closed just beyond by a small turn of
    the links; else it is a limit of motion.

    Args:
        start: (TU + TK,) the state at the last sample time that was reached; `last` is on the way from there to the next.
        direction: (TK,) change of the inputs to the next sample time, divided by its largest entry.
        failure: the exception of the last step, which failed.
    """
    unknowns, x = len(equations.unknown), last.x
    # a state beyond the end: all variables continue their change since the sample, the inputs by BEYOND
    moved = float(np.abs(x - start)[unknowns:].max())
    guess = x + (x - start) * (BEYOND / moved if moved else 0.0)
    guess[unknowns:] = x[unknowns:] + BEYOND * direction
    try:
        closed, _, _ = equations.close(guess)
        singular = largest((closed - x)[equations.is_angle]) < LARGEST_TURN
    except Stopped as error:
        singular = error.singular
    if singular:
        return _End(f"singular position, from which the motion can go on in more than one way ({failure})", True, x)
    return _End("limit of motion, beyond which the linkage cannot be closed", False, x)


def _motion(equations: LoopEquations, states: list[_State], input_rates: list[Array]) -> Motion:
    """Return the motion through closed states, in absolute coordinates.

    `input_rates` are the first and second time derivatives (k, TK) of the inputs.
    """
    # x, x', x'' of each state; a motion that ends early has fewer states than the inputs have times
    x_and_rates = [(s.x, *equations.rates(s.x, *derivatives)) for s, *derivatives in zip(states, *input_rates, strict=False)]
    x = np.array(x_and_rates).reshape(len(states), 3, len(equations.variables)).swapaxes(0, 1)
    return Motion(*equations.absolute(*x), np.array([s.steps for s in states], dtype=int))
