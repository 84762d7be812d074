"""The formulas that the audit of the papers checks, as functions, and measures that compare them with a reference.

The audit (`papers/audit.py`) checks statements of three papers. A statement that is printed wrongly has two versions, called forms:
as printed, and as intended by the authors. A form is a function that evaluates a formula, or a number or a list that the formula
contains.

Each module here has the formulas of one or more chapters of the data files (`papers/*.toml`):
- `least_squares`, `projector`, `example`: Yuan & Ge 2016, on random problems with known solutions (`problems`) and on their own
  example, the crank-slider (`gauss_bench.papers.crank_slider`).
- `link_units`, `loops`: Wang et al. 2010, on exact derivatives and on the motions of linkage files.
- `points`: Men et al. 2009, on the shaper.

A function NAME_off is a measure: it returns the discrepancy of a form from a reference, a number >= 0. Its first argument is the
form. If the data file names a list of cases for the measure, for example states of a linkage, the second argument is one case.
"""
