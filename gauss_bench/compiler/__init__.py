"""The compiler, which turns a linkage into native code: equations, elimination, machine code, time steps. See README.md."""
