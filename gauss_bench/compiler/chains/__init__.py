"""Large linkages: loops over equal operations."""
