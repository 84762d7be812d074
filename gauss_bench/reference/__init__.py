"""References: trajectories and accelerations that are more exact than the runs they judge, each with its error bar.

No file here uses a formulation or an integrator under test. - In double precision: `minimal` (one coordinate) and `absolute` (all
coordinates). `build` makes a reference and its error bars from
  two runs; `sensitivity` finds how far rounding of the parameters moves a motion.
- Certified: `certify` compares two pipelines in extended precision that share no equations, `taylor` (loop coordinates, Taylor
  series) and `extended` (absolute coordinates, by `extended_linkage`, `collocation` and `refinement`), and the closed form in
  `exact` if there is one. All return a `motion`. The digits in which they agree are stored as a `certificate`, which `verification`
  checks.
- `store` returns a certified reference if there is one; else it builds a reference and keeps it in a cache.
"""
