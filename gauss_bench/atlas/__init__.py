"""The reach of each engine: families of linkages that become harder along one axis, and where along it an engine breaks."""
