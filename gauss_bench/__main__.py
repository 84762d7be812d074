"""`python -m gauss_bench` is `gauss-bench`."""

import sys


def run() -> int:
    """Run the command line and return the exit code: 130 if it was interrupted, also while its modules were imported."""
    try:
        from gauss_bench.cli import command

        return command()
    except KeyboardInterrupt:
        return 130  # as `cli.INTERRUPTED`, which may not be imported yet


if __name__ == "__main__":
    sys.exit(run())
