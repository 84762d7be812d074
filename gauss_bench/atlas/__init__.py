"""The limits of each engine on families of linkages that become harder along one axis."""
