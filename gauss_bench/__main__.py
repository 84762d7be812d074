"""`python -m gauss_bench` is `gauss-bench`."""

import sys

from gauss_bench.cli import command

if __name__ == "__main__":
    sys.exit(command())
