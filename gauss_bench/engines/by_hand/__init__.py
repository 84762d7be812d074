"""Equations of motion in the crank's angle alone, as a skilled engineer derives them and writes them in C for one linkage.

`crank_slider.c` and `four_bar.c` have the equations. `loops` computes their constants for a linkage; `adapter` runs them.
"""
