"""The adapter to OpenSim, whose dynamics are Simbody's. Its library cannot share a process with CasADi: it has an environment.

`translate.py` builds the model; `adapter.py` runs it; `forces.py` reads the forces of its joints.
"""
