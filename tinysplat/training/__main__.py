"""The command: python -m tinysplat.training CONFIG.toml --out DIR [--minutes N | --steps N] [--resume] …."""

import argparse
import signal
import sys
from pathlib import Path

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.system.progress import still_there


def main(arguments: list[str] | None = None) -> int:
    """Train; 0 when done, 2 when what was given cannot be used, 130 when stopped by a signal, after a checkpoint."""
    parser = argparse.ArgumentParser(
        prog="python -m tinysplat.training",
        description="Train the network edge, from the photos and poses of --photos or of the configuration, else from"
        " scenes that are made on the way; docs/MODELS.md says how to export what comes of it.",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for the checkpoint")
    parser.add_argument("--minutes", type=float, help="stop after so long; default: at the configured step")
    parser.add_argument("--steps", type=int, metavar="N", help="stop after so many; default: at the configured step")
    parser.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint")
    parser.add_argument("--start", type=Path, metavar="CHECKPOINT", help="begin with these weights")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), help="in place of the configuration's")
    for name, text in (("photos", "scene folders"), ("pictures", "textures"), ("validation", "scenes to validate on")):
        parser.add_argument(f"--{name}", type=Path, metavar="PATH", help=f"folder of {text}, likewise")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        with still_there("training", quiet=False):  # while torch loads
            from .config import load_config
            from .loop import train

        given = {name: getattr(options, name) for name in ("photos", "pictures", "validation", "device")}
        config = load_config(options.config, **{name: str(value) for name, value in given.items() if value is not None})
        train(
            config,
            options.out,
            resume=options.resume,
            start=options.start,
            minutes=options.minutes,
            steps=options.steps,
            say=_say,
        )
    except (TinySplatError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        print(f'error: needs the package {error.name}; pip install "tinysplat[train]" brings it', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _interrupt(signum: int, frame: object) -> None:
    raise KeyboardInterrupt


def _say(line: str) -> None:
    clear = "\r\033[K" if sys.stderr.isatty() else ""  # of what says that a step is under way
    print(clear, end="", file=sys.stderr, flush=True)
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
