"""References: trajectories and accelerations that are more exact than the runs they judge, each with its error bar.

No file here uses a formulation or an integrator under test.

- In double precision, `build` makes a reference from two runs, by equations in one coordinate (`minimal`) or in all (`absolute`).
  `sensitivity` finds how far rounding of the parameters moves a motion.
- `certify` compares the motions of two computations in extended precision that share no equations, `taylor` and `extended`, and the
  closed form in `exact` if there is one. The digits in which they agree make a `certificate`, which `verification` checks.
- `store` returns a certified reference if there is one; otherwise it builds a reference and keeps it in a cache.
"""
