"""Kinematics: the motion of a linkage without forces.

Two methods compute the motion that the drivers of a scenario, the inputs, prescribe. Both return a `motion` and raise the
exceptions of `errors`.
- Loop closure: `topology` (links and pairs as a graph, and its independent loops), `link_units` (the contribution of one link to
  the equations of a loop), `loop_equations` (all loops as one system), `loop_closure` (the motion).
- Point coordinates: `points` (the points that determine a linkage), `point_equations` (the equations between them),
  `basic_coordinates` (the motion).

`root_finding` has the solvers of the point equations at one position, and `basins` studies from how far away they converge.
`singular` finds limits of motion and dead centres, `branches` other assemblies with the same inputs, `assembly` the loop of a
drawing that does not close, `synthesis` four-bars through given poses. `centres` and `advantage` compute instant centres and ratios
of velocities and forces. `freedom` has the free motions at a position, and `dragging` moves a linkage by one of its points.
"""
