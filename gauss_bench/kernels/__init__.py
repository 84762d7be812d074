"""Names of the package `compiler` as they were called before; kept for one release."""
