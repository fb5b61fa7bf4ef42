"""The command `tinysplat`: parser, commands, and what they share."""

from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; see `run.main`, which is loaded here so that importing this package is free."""
    from .run import main as run

    return run(argv)
