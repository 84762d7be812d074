"""A linkage becomes native code: equations, elimination, machine code, and the programs made of it."""
