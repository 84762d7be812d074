"""Equations of motion in the crank's angle alone, as a skilled engineer writes them by hand in C for one linkage at a time.

`crank_slider.c` and `four_bar.c` are the derivations, `loops` takes their numbers from a linkage, `adapter` compiles and runs them.
"""
