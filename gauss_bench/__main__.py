"""`python -m gauss_bench` runs the command `gauss-bench`."""

import sys


def run() -> int:
    """Run the command line and return the exit code, which is 130 after an interrupt, even during imports."""
    try:
        from gauss_bench.cli import command

        return command()
    except KeyboardInterrupt:
        return 130  # as `cli.INTERRUPTED`, which may not be imported yet


if __name__ == "__main__":
    sys.exit(run())
