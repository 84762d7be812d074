"""Export linkages to other programs and import models from them; README.md explains the modules in order."""
