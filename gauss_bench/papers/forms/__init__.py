"""The forms of the audit's lines as functions, printed and corrected, and measures that compare a form with a reference.

A module for each chapter of the data files:
- `least_squares`, `projector`, `example`: Yuan & Ge 2016, on random problems with known solutions (`problems`) and on their own
  example, the crank-slider (`gauss_bench.papers.crank_slider`).
- `link_units`, `loops`: Wang et al. 2010, on exact derivatives and on the motions of linkage files.
- `points`: Men et al. 2009, on the shaper.

A function NAME_off is a measure: it takes a form, and a case where the data file lists cases, and returns the discrepancy, >= 0.
"""
