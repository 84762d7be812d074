"""The formulas that the audit checks, as functions, and measures that compare them with a reference.

A formula that the paper prints wrongly has two forms, as printed and as intended. Every statement of `papers/audit.py` has a form,
which is such a function, or a number or list that a formula contains.

A module for each chapter of the data files:
- `least_squares`, `projector`, `example`: Yuan & Ge 2016, on random problems with known solutions (`problems`) and on their own
  example, the crank-slider (`gauss_bench.papers.crank_slider`).
- `link_units`, `loops`: Wang et al. 2010, on exact derivatives and on the motions of linkage files.
- `points`: Men et al. 2009, on the shaper.

A function NAME_off is a measure: it takes a form and, if the data file lists cases, one case, and returns the discrepancy of the
form from a reference, >= 0.
"""
