"""References: trajectories and accelerations more exact than the runs that they judge, each with its own error bar.

No file here uses a formulation or an integrator under test.
- In double precision: `minimal` (one coordinate), `absolute` (all coordinates), `build`, which makes a reference and its error bars
  from two runs, and `sensitivity`, which finds how far rounding of the parameters moves a motion.
- Certified: `certify` compares two pipelines in extended precision that share no equations, `taylor` (loop coordinates, Taylor
  series) and `extended` (absolute coordinates, by `extended_linkage`, `collocation` and `refinement`), and the closed form in
  `exact` where a motion has one. All return a `motion`; the digits in which they agree are stored as a `certificate`, which
  `verification` checks.
- `store` returns a certified reference if there is one; else it builds one and keeps it in a cache.
"""
