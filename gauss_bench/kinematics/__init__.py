"""Kinematics: the motion of a linkage without forces.

Two methods, loop closure and point coordinates, compute the motion that the drivers of a scenario (the inputs) prescribe. The
results are the `Motion` of the module `motion`, and the exceptions of the module `errors`.

Modules of the loop closure:
- `topology`: links and pairs as a graph, and its independent loops.
- `link_units`: the contribution of one link to the equations of a loop.
- `loop_equations`: the equations of all loops as one system.
- `loop_closure`: the motion.

Modules of the point coordinates:
- `points`: the points that determine a linkage.
- `point_equations`: the equations between these points.
- `basic_coordinates`: the motion.
- `root_finding`: the solvers of the point equations at one position.
- `basins`: a study of how far from a solution these solvers still converge to it.

Other modules:
- `singular`: limits of motion and dead centres.
- `branches`: the other assemblies with the same inputs.
- `assembly`: the loop of a drawn linkage that cannot be closed.
- `synthesis`: four-bars through given poses.
- `centres`: instant centres.
- `advantage`: ratios of velocities and of forces.
- `freedom`: the free motions at a position.
- `dragging`: a linkage is moved by one of its points.
"""
