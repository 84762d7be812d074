"""The adapter to OpenSim, whose dynamics are Simbody's. OpenSim cannot share a process with CasADi, so it has its own environment.

`translate.py` builds the model; `adapter.py` runs it; `forces.py` reads the forces of its joints; `program.py` writes programs.
"""
