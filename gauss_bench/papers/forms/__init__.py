"""The formulas that the audit of the papers checks, as functions, and measures that compare them with a reference.

Each module has the formulas of one or more chapters of the data files:
- `least_squares`, `example`: Yuan & Ge 2016, on random problems with known solutions (`problems`) and on the crank-slider.
- `link_units`, `loops`: Wang et al. 2010, on exact derivatives and on the motions of linkage files.
- `points`: Men et al. 2009, on the shaper.

A function NAME_off is a measure: it returns the discrepancy of a form (its first argument) from a reference, a number >= 0. If the
data file gives cases, its second argument is a case.
"""
