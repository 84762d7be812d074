"""Kinematics: the motion of a linkage without forces.

Two methods compute the motion (`motion`) that the drivers of a scenario (the inputs) prescribe:
- loop closure: `topology`, `link_units`, `loop_equations`, `loop_closure`.
- point coordinates: `points`, `point_equations`, `root_finding`, `basic_coordinates`; `basins` studies the convergence.

Other modules:
- `singular`: limits of motion and dead centres.
- `branches`: the other assemblies with the same inputs.
- `assembly`: the loop of a drawn linkage that cannot be closed.
- `synthesis`: four-bars through given poses.
- `centres`: instant centres, ratios of velocities and of forces.
- `freedom`, `dragging`: the free motions at a position, and a linkage that is dragged by one of its points.

The papers of Wang et al. (2010) and Men et al. (2009) are cited in `gauss_bench.papers`.
"""
