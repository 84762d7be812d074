"""How a linkage moves, without forces: loops, point coordinates, singular positions.

Both methods take the drivers of a scenario as `inputs`, return a `motion` and raise the exceptions of `errors`.
- By loops: `topology` (links and pairs as a graph, its independent loops), `link_units` (what one link adds to a loop's equations),
  `loop_equations` (all loops as one system), `loop_closure` (the motion).
- By points: `points` (which points carry a linkage, which are known), `point_equations` (what holds between them),
  `basic_coordinates` (the motion).
- `root_finding` solves either system at one position, and `basins` asks from how far away it does.
- `singular` finds limits of motion and dead centres; `assembly` says which loop of a drawing does not close, and why.
- `branches` finds other assemblies with the same input; `centres` and `advantage` tell velocities and forces by ratios.
By hand, without drivers: `freedom` says what can move at a position, and `dragging` draws the linkage along by a point.
"""
