"""Time stepping by native code."""
