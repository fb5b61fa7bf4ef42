"""`tinysplat view`: a scene in the browser, or as one web page."""

from __future__ import annotations

import http.server
import threading
import webbrowser
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..api import decompress
from ..container.inspection import inspect_bytes
from ..errors import InputError, TinySplatError
from ..formats.table import load_gaussians
from ..gaussian.gaussians import Gaussians
from ..page.build import Page, build_page
from ..scene.cameras import Camera
from ..scene.intake.layouts import load_cameras, load_scene
from ..scene.matching import reach_of, taken_as
from ..scene.scenes import Scene
from ..system.files import read_limited, write_atomically
from .files import MAX_FILE_BYTES


def view(args: Namespace) -> None:
    """Make the page; write it, or serve it until interrupted."""
    page = make_page(args.file, args.cameras, args.photos)
    if args.html:
        text = page.whole().encode()
        write_atomically(args.html, text)
        if not args.quiet:
            print(f"{args.html}: {len(text) / 1e6:.1f} MB, opens without a network")
        return
    serve(page, args.port, quiet=args.quiet, browser=not args.no_browser)


def make_page(file: str, cameras_file: str | None, photos_of: str | None) -> Page:
    """The page of a file, with views of `cameras_file` where it has none and the photos of the scene `photos_of`."""
    gaussians = _load(file)
    cameras = list(gaussians.cameras) or (load_cameras(cameras_file) if cameras_file else [])
    photos = _photos(load_scene(photos_of), cameras) if photos_of and cameras else {}
    described = _described(file)
    summary = f"{gaussians.count:,} Gaussians, SH degree {gaussians.degree}"
    if described:
        summary += f"; {described['bytes'] / 1000:.1f} KB, profile {described['profile']}"
    who = ", ".join(filter(None, (gaussians.notes.attribution, gaussians.notes.licence)))
    summary += f"; {who}" if who else ""
    classes = {**described["bytes_by_class"], "metadata": described["metadata_bytes"]} if described else {}
    return build_page(
        gaussians,
        cameras,
        title=Path(file).stem,
        caption=_caption(len(gaussians.cameras), described),
        summary=summary,
        bytes_by_class=classes,
        photos=photos,
    )


def _caption(views: int, described: dict[str, Any]) -> str:
    photos = f"{views} photos" if views > 1 else "1 photo" if views else ""
    size = f"{described['bytes'] / 1000:.0f} KB" if described else ""
    return " · ".join(filter(None, (photos, size)))


def serve(page: Page, port_number: int, *, quiet: bool, browser: bool) -> None:
    """Serve the page on this machine alone until interrupted."""
    text = ("text/html; charset=utf-8", page.served().encode())
    parts = {"/": text, "/index.html": text, "/data": ("application/octet-stream", page.data)}

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            kind, body = parts.get(self.path.partition("?")[0], ("text/plain", b""))
            self.send_response(200 if body else 404)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are nobody's concern."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", port_number), Handler) as server:
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        if not quiet:
            print(f"{address} (Ctrl-C ends)", flush=True)
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        server.serve_forever()


def _load(file: str) -> Gaussians:
    if Path(file).suffix.lower() != ".tsplat":
        return load_gaussians(file)
    try:
        return decompress(read_limited(file, MAX_FILE_BYTES))
    except TinySplatError as error:
        raise error.within(file) from None


def _described(file: str) -> dict[str, Any]:
    if Path(file).suffix.lower() != ".tsplat":
        return {}
    return inspect_bytes(read_limited(file, MAX_FILE_BYTES))


def _photos(scene: Scene, cameras: Sequence[Camera]) -> dict[int, NDArray]:
    """Photos of the views that a scene's frames were taken from, by view.

    Raises:
        InputError: no frame belongs to any view.
    """
    photos: dict[int, NDArray] = {}
    reach = max(reach_of(cameras), 1e-9)
    for i, camera in enumerate(cameras):
        photo, *_ = taken_as(camera, scene, reach)
        if photo is not None:
            photos[i] = scene.frames[photo].resized(camera.height, camera.width).image()
    if not photos:
        raise InputError("no photo was taken from any of the file's views", where=str(scene.path))
    return photos
