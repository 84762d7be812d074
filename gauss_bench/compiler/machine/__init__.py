"""Machine arithmetic, routines with loops that use it, and the native code of these routines."""
