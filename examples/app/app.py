"""Photos or a video in, a page to look around in out: TinySplat for people without a terminal.

    pip install "tinysplat[app]"
    python examples/app/app.py

The folder is also a Hugging Face Space as it stands (two cores, no GPU). The work is done by the command line in
processes of their own, whose time and memory are bounded.
"""

from __future__ import annotations

import html
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

try:
    import gradio as gr
except ImportError:
    print('tinysplat: app: needs gradio; pip install "tinysplat[app]" brings it', file=sys.stderr)
    sys.exit(2)

PHOTOS, VIDEOS = (".jpg", ".jpeg", ".png", ".heic", ".heif"), (".mp4", ".mov", ".mkv", ".webm")
MOST_PHOTOS, MOST_BYTES = 100, 300_000_000
MOST_SECONDS = 1200
MOST_MEMORY = 12_000_000_000

INTRODUCTION = """# TinySplat
Drop a video of a place, filmed while walking slowly, or 10 to 60 photos of it, taken a small step apart. What comes out
is a page that opens in any browser, offline too. What is being done is said all along.
What you drop is deleted here within two hours."""
KEPT_SECONDS = 3600

STEPS = {
    "poses": "Finding where each photo was taken (step 1 of 3)",
    "encode": "Making the scene (step 2 of 3)",
    "view": "Writing the page (step 3 of 3)",
}
SHOWN = "document.getElementById('scene').scrollIntoView({ behavior: 'smooth' })"


def command(*words: str | Path) -> list[str]:
    """A command of TinySplat's for a process of its own."""
    return [sys.executable, "-m", "tinysplat_runtime", *map(str, words)]


def refusal(files: list[Path]) -> str:
    """What is wrong with what was dropped; nothing where it can be used."""
    kinds, total = {file.suffix.lower() for file in files}, sum(file.stat().st_size for file in files)
    if not files:
        return "Drop a video or photos first."
    if total > MOST_BYTES:
        return f"{total / 1e6:.0f} MB, where {MOST_BYTES / 1e6:.0f} are taken."
    if len(files) == 1 and kinds <= set(VIDEOS):
        return ""
    if not kinds <= set(PHOTOS):
        return f"One video ({', '.join(VIDEOS)}), or photos ({', '.join(PHOTOS)}), please."
    return "" if 2 <= len(files) <= MOST_PHOTOS else f"{len(files)} photos, where 2 to {MOST_PHOTOS} are taken."


def bounded() -> None:
    """Bound the memory of a process that is about to start, where the system can."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


def lines_of(words: list[str]) -> Iterator[str]:
    """What a command says, line by line; fails with its last line where it does."""
    process = subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        preexec_fn=bounded if os.name == "posix" else None,
    )
    clock = threading.Timer(MOST_SECONDS, process.kill)
    clock.start()
    last = ""
    try:
        assert process.stdout is not None
        for line in process.stdout:
            last = line.strip() or last
            yield last
    finally:
        clock.cancel()
        process.kill()
    if process.wait():
        raise gr.Error(last or f"ended after {MOST_SECONDS} s")


def in_words(step: str, line: str) -> str:
    """What is being done, for people, of a line that a command says."""
    count = re.search(r"\b(\d+)/(\d+)$", line)
    return f"{STEPS[step]}, {count[1]} of {count[2]}" if count else STEPS[step]


def make(files: list[str] | None) -> Iterator[tuple[str, str | None, list[str] | None]]:
    """Words of what is being done, and at last the page to show and the files to keep."""
    dropped = [Path(file) for file in files or []]
    if wrong := refusal(dropped):
        raise gr.Error(wrong)
    with tempfile.TemporaryDirectory(prefix="tinysplat_app_") as work:
        yield from made(dropped, Path(work))


def made(dropped: list[Path], folder: Path) -> Iterator[tuple[str, str | None, list[str] | None]]:
    """As `make`, of files that can be used, in a folder of their own."""
    source, scene, file, page = folder / "photos", folder / "scene", folder / "scene.tsplat", folder / "scene.html"
    if len(dropped) == 1:
        source = source.with_suffix(dropped[0].suffix.lower())
        shutil.copy(dropped[0], source)
    else:
        source.mkdir()
        for number, photo in enumerate(sorted(dropped)):
            shutil.copy(photo, source / f"{number:04}{photo.suffix.lower()}")
    last = ""
    for step, words in {
        "poses": command("poses", source, "-o", scene),
        "encode": command("encode", scene, "-o", file),
        "view": command("view", file, "--html", page),
    }.items():
        yield STEPS[step], None, None
        for line in lines_of(words):
            last = line if step == "encode" else last
            yield in_words(step, line), None, None
    shown = html.escape(page.read_text("utf-8"), quote=True)
    frame = f'<iframe style="width: 100%; height: 70vh; border: 0" title="The scene" srcdoc="{shown}"></iframe>'
    yield f"Ready: {last.replace(f'{folder}/', '')}", frame, [str(page), str(file)]


with gr.Blocks(title="TinySplat", delete_cache=(KEPT_SECONDS, KEPT_SECONDS)) as app:
    gr.Markdown(INTRODUCTION)
    scene_page = gr.HTML(elem_id="scene")
    given = gr.File(label="A video or photos", file_count="multiple", file_types=[*PHOTOS, *VIDEOS], height=160)
    start = gr.Button("Make the scene", variant="primary")
    stages = gr.Textbox(label="What is being done", lines=1, max_lines=3)
    results = gr.File(label="The page to send, and the file", file_count="multiple")
    done = start.click(make, given, [stages, scene_page, results], api_name="make", concurrency_limit=1)
    done.success(None, js=f"() => {{ {SHOWN}; }}")

if __name__ == "__main__":
    app.queue(max_size=8).launch(max_file_size=MOST_BYTES)
