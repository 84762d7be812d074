"""The truth: trajectories and accelerations more exact than what they judge, each with its own error bar.

Nothing here uses a formulation or an integrator under test.
- In double precision: `minimal` (one coordinate), `absolute` (all coordinates) and `build`, which makes a reference and its error
  bars of two runs; `sensitivity` (how far rounding of the parameters moves a motion).
- Certified: `certify` compares two pipelines in extended precision that share no equations, `taylor` (loop coordinates, Taylor
  series) and `extended` (absolute coordinates, by `extended_linkage`, `collocation` and `refinement`), or `exact` where a motion
  has a closed form. All return a `motion`; what they agree on is kept as a `certificate`, which `verification` checks again.
- `store` gives whoever asks a certified reference where there is one, else a built one.
"""
