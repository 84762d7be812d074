"""Code generation: a graph of machine arithmetic, routines with loops over this graph, and their compilation to native code."""
