"""What users, files and plug-ins rely on, as it was stored once: nothing here may change together with the package."""
