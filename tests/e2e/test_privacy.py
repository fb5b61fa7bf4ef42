"""Nothing but the outputs asked for is written, and nothing is looked up."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import write_scene

SCRIPT = Path(sys.executable).with_name("tinysplat")

HOOK = """
import sys

def refuse(event, args):
    if event.startswith("socket.") and event != "socket.__new__":
        raise SystemExit(f"{event} {args}")

sys.addaudithook(refuse)
"""


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "home").mkdir()
    (tmp_path / "temporary").mkdir()
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook" / "sitecustomize.py").write_text(HOOK)
    write_scene(tmp_path / "desk", views=2, height=64, width=96)
    return tmp_path


def run(place: Path, *words: object, **variables: str) -> None:
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "ORT_"))},
        "HOME": str(place / "home"),
        "TMPDIR": str(place / "temporary"),
        "PYTHONPATH": str(place / "hook"),
        **variables,
    }
    done = subprocess.run(
        [str(SCRIPT), *map(str, words)], cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def files(place: Path) -> set[str]:
    ours = (path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file())
    return {name for name in ours if not name.startswith(("desk/", "hook/"))}


def test_commands_write_what_they_are_asked_for_and_look_nothing_up(place: Path) -> None:
    run(place, "encode", "desk", "-o", "a.tsplat")
    run(place, "decode", "a.tsplat", "-o", "a.npz")
    run(place, "compress", "a.npz", "-o", "b.tsplat")
    run(place, "render", "a.tsplat", "-o", "a.png")
    run(place, "view", "a.tsplat", "--html", "a.html")
    for command in ("doctor", "models"):
        run(place, command)
    assert files(place) == {"a.tsplat", "a.npz", "b.tsplat", "a.png", "a.html"}


def test_a_choice_of_the_user_s_about_telemetry_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    from tinysplat_runtime.graphs.inference import onnxruntime

    monkeypatch.setenv("ORT_DISABLE_TELEMETRY", "0")
    onnxruntime()
    assert os.environ["ORT_DISABLE_TELEMETRY"] == "0"
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY")
    onnxruntime()
    assert os.environ["ORT_DISABLE_TELEMETRY"] == "1"
