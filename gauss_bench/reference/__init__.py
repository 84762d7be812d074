"""References: trajectories and accelerations more exact than the runs that they judge, each with its own error bar.

Nothing here uses a formulation or an integrator under test.
- In double precision: `minimal` (one coordinate), `absolute` (all coordinates), `build`, which makes a reference and its error bars
  from two runs, and `sensitivity` (how far rounding of the parameters moves a motion).
- Certified: `certify` compares two pipelines in extended precision that share no equations, `taylor` (loop coordinates, Taylor
  series) and `extended` (absolute coordinates, by `extended_linkage`, `collocation` and `refinement`), or `exact` where a motion
  has a closed form. All return a `motion`; the digits on which they agree are stored as a `certificate`, checked by `verification`.
- `store` returns a certified reference if there is one, else it builds one and caches it.
"""
