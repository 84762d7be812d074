"""The first of the two computations that certify a reference motion: Taylor series in 128-bit numbers, in loop coordinates.

The position of every point is a sum of vectors (`vector_sums`), from which the constraint rows (`rows`) and the forces (`forces`)
follow. The equations of motion are reduced to as many unknowns as there are degrees of freedom (`equations`, `elimination`) and
compiled (`compiled`). The equations are integrated by Taylor series; where necessary, another choice of independent coordinates (a
chart) is made (`march`). The states are converted to samples in absolute coordinates with joint forces (`samples`, `joint_forces`).
"""
