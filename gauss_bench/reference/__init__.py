"""References: trajectories and accelerations that are more exact than the runs they judge, each with its error bar.

No file here uses a formulation or an integrator under test.

- References in double precision: `minimal` has the equations in one coordinate, and `absolute` those in all coordinates. `build`
  makes a reference and its error bars from two runs. `sensitivity` finds how far rounding of the parameters moves a motion.
- Certified references: `certify` compares the motions of two independent computations in extended precision (pipelines) that share
  no equations: `taylor` (loop coordinates, Taylor series) and `extended` (absolute coordinates, by `collocation` and `refinement`).
  If the motion has a closed form in `exact`, that is compared too. The digits in which the motions agree are stored in a file, the
  `certificate`, which `verification` checks.
- `store` returns a certified reference if there is one; otherwise it builds a reference and keeps it in a cache.
"""
