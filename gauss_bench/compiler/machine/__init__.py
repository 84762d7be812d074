"""Machine arithmetic, its loops, and native code."""
