"""Equations as a skilled engineer writes them by hand, in the crank's angle alone, in C, for one linkage at a time.

`crank_slider.c` and `four_bar.c` are the derivations, `loops` reads their numbers off a linkage, `adapter` compiles and runs them.
"""
