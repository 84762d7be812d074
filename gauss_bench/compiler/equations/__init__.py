"""The equations of a linkage as expressions."""
