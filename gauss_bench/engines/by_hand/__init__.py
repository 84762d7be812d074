"""Equations of motion in the crank's angle alone, as a skilled engineer derives them and writes them in C for one linkage.

`crank_slider.c` and `four_bar.c` are the derivations. `loops` takes their numbers from a linkage; `adapter` compiles and runs them.
"""
