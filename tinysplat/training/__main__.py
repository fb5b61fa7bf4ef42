"""The command: python -m tinysplat.training CONFIG.toml --out DIR [--minutes N] [--resume] [--device NAME]."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import TinySplatError


def main(arguments: list[str] | None = None) -> int:
    """Train; 0 when done, 2 when what was given cannot be used, 130 when stopped by a signal, after a checkpoint."""
    parser = argparse.ArgumentParser(prog="python -m tinysplat.training", description="Train the network edge.")
    parser.add_argument("config", type=Path, metavar="CONFIG.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for checkpoint and curves")
    parser.add_argument("--minutes", type=float, help="stop after so long; default: at the configured step")
    parser.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint")
    parser.add_argument("--start", type=Path, metavar="CHECKPOINT", help="begin with these weights")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), help="in place of the configuration's")
    for name, text in (("photos", "scene folders"), ("pictures", "textures"), ("validation", "scenes to validate on")):
        parser.add_argument(f"--{name}", type=Path, metavar="PATH", help=f"folder or .zip of {text}, likewise")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        from .config import load_config
        from .loop import train

        given = {name: getattr(options, name) for name in ("photos", "pictures", "validation", "device")}
        config = load_config(options.config, **{name: str(value) for name, value in given.items() if value is not None})
        train(config, options.out, resume=options.resume, start=options.start, minutes=options.minutes, say=_say)
    except (TinySplatError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        print(f'error: needs the package {error.name}; pip install "tinysplat[train]" brings it', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt


def _say(line: str) -> None:
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
