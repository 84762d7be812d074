"""The first of the two computations that certify a reference motion: Taylor series in 128-bit numbers, in loop coordinates.

The position of every point is a sum of vectors (`vector_sums`), from which the constraint rows (`rows`) and the forces (`forces`)
follow. The equations of motion are reduced to the degrees of freedom (`equations`, `elimination`), compiled (`compiled`) and
integrated (`series`). The states become samples in absolute coordinates with joint forces (`samples`).
"""
