"""The command as a process: it ends at once, and nothing that it had to say or do is lost by that."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def run(body: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """A process whose command `models` is `body`."""
    code = (
        "import atexit, gc, sys, threading, time\n"
        "from tinysplat_runtime.cli import commands\n"
        f"def models(args):\n{body}"
        "commands.models = models\n"
        "from tinysplat_runtime.__main__ import main\n"
        "sys.exit(main())\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "runtime")}
    command = [sys.executable, "-c", code, *map(str, words or ("models",))]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_what_was_said_and_registered_is_out_before_the_process_ends() -> None:
    done = run(
        "    threading.Thread(target=lambda: (time.sleep(0.2), print('a thread'))).start()\n"
        "    atexit.register(print, 'last words')\n"
        "    sys.stdout.write('no line feed')\n"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "no line feeda thread\nlast words\n", "")


@pytest.mark.parametrize(
    ("body", "words", "status", "error"),
    [
        ("    raise ZeroDivisionError\n", ("models",), 1, "Traceback"),
        ("    pass\n", ("info", "absent.tsplat"), 2, "absent.tsplat"),
        ("    pass\n", ("models", "--unknown"), 2, "--unknown"),
    ],
)
def test_the_status_is_that_of_the_command(body, words, status, error) -> None:
    done = run(body, *words)
    assert done.returncode == status and error in done.stderr
