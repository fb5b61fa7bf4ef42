"""`tinysplat view`: a scene in the browser, or as one web page, or a player of any file."""

from __future__ import annotations

import http.server
import math
import threading
import webbrowser
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from ..api import Runtime
from ..container.layout import MAX_FILE_BYTES, SUFFIX
from ..container.photos import Photos
from ..container.reader import read_container
from ..errors import InputError, within
from ..formats.table import load_gaussians
from ..gaussian.gaussians import Gaussians
from ..page.build import PageContent, player_page, scene_files, scene_page
from ..page.front import front_of, front_view
from ..page.story import load_story, story_of
from ..render import render
from ..scene.cameras import Camera
from ..scene.intake.layouts import load_cameras, load_scene
from ..scene.scenes import Scene
from ..system.files import read_limited, write_atomically
from ..system.printable import printable
from ..system.progress import wipe
from ..system.told import NOBODY, Told
from .asks import View
from .options import asked
from .outputs import made_folder

FINE_QP = -6.0
"""Q_g of scenes that come in other formats: half the steps of a file's, as it is coded only to be looked at."""

POSTER_SIDE = 480
"""Pixels of the longer side of the picture that is shown until the scene is drawn."""

MOST_PHOTO = 2_000_000
"""Pixels of a photo that a page carries to compare with."""

FOREIGN_HOST = "This page is for this machine: open it at http://127.0.0.1, or write it to a file with --html\n"


def view(args: Namespace) -> None:
    """Make the page; write it, or serve it until interrupted."""
    own = asked(args, View)
    if own.player and own.file is not None:
        raise InputError("goes without --player, whose page opens files that are dropped on it", where=own.file)
    if own.player and own.html:
        written = _written(own.html, player_page())
    elif own.file is None:
        raise InputError("missing; name a scene, or write a player of any with --player", where="F")
    else:
        content = Content.of(own.file, own.cameras, own.photos, own.background, own.story, own.voice)
        if own.html is None:
            page = scene_page(content.data, content.shown)
            serve(page, own.port, quiet=own.quiet, browser=not own.no_browser)
            return
        if own.files:
            written = _written_files(own.html, scene_files(content.data, content.shown))
        else:
            written = _written(own.html, scene_page(content.data, content.shown))
    if not own.quiet:
        wipe()
        print(written)


def _written(path: str, page: str) -> str:
    text = page.encode()
    write_atomically(path, text)
    return f"{path}: {len(text) / 1e3:.0f} KB, opens without a network"


def _written_files(folder: str, files: Mapping[str, bytes]) -> str:
    target = made_folder(folder)
    for name, data in files.items():
        write_atomically(target / name, data)
    size = sum(map(len, files.values()))
    return f"{target / 'index.html'}: {size / 1e3:.0f} KB in {len(files)} files, for a web server to give"


@dataclass(frozen=True)
class Content:
    """What a page shows.

    Attributes:
        data: the .tsplat file.
        shown: the rest.
    """

    data: bytes
    shown: PageContent

    @classmethod
    def of(
        cls,
        file: str,
        cameras_file: str | None,
        photos_of: str | None,
        background: tuple[float, float, float] | None = None,
        story_file: str | None = None,
        told: Told = NOBODY,
    ) -> Content:
        """Of a file, with views of `cameras_file` where it has none, the photos of the scene `photos_of`, and a story:
        of `story_file`, or where that is empty one that is yet to be made.
        """
        story = None if story_file is None else load_story(story_file) if story_file else story_of({})
        runtime = Runtime(told=told)
        data, views = _file(file, runtime)
        cameras = load_cameras(cameras_file) if cameras_file and not views else []
        photos = {}
        if photos_of and not (views or cameras):
            raise InputError(f"{photos_of}, but {file} has no views; --cameras gives it some", where="--photos")
        if photos_of:
            photos = _photos(load_scene(photos_of).with_masks(None), views or cameras, told)  # as they were taken
        first = front_view(views or cameras)
        front = (views or cameras)[first] if views or cameras else None
        gaussians = runtime.decompress(data)
        front = front or front_of(gaussians)
        if not (views or cameras):
            first = front_view(gaussians.viewpoints)
        if story is not None:
            with within(story_file or ""):
                story.check_scene(gaussians.flat().means + gaussians.origin, front.centre)
        poster, title = _poster(gaussians, front, background), printable(Path(file).stem)
        told_by = None if story is None else story.document
        return cls(data, PageContent(title, cameras, photos, first, poster, background, told_by))


def _poster(gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] | None) -> NDArray:
    """The picture (H, W, 3) from a camera."""
    scale = min(1.0, POSTER_SIDE / max(camera.height, camera.width))
    small = camera.resized(round(scale * camera.height), round(scale * camera.width))
    picture: NDArray = render(gaussians, small, background=background or (0, 0, 0))
    return picture


def serve(page: str, port_number: int, *, quiet: bool, browser: bool) -> None:
    """Serve the page on this machine alone until interrupted."""
    text = page.encode()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if not is_this_machine(self.headers.get("Host", "")):
                self._answer(HTTPStatus.FORBIDDEN, "text/plain", FOREIGN_HOST.encode())
            elif self.path.partition("?")[0] in ("/", "/index.html"):
                self._answer(HTTPStatus.OK, "text/html; charset=utf-8", text)
            else:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"")

        do_HEAD = do_GET  # noqa: N815  as the library calls it

        def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Requests are nobody's concern."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", port_number), Handler) as server:
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        if not quiet:
            print(f"{address} (Ctrl-C ends)", flush=True)
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        server.serve_forever()


def is_this_machine(host: str) -> bool:
    """Whether a request's `Host` is an address or localhost: not the name of a site that leads here for its scripts."""
    name = urlsplit(f"//{host}").hostname or ""
    try:
        ip_address(name)
    except ValueError:
        return name in ("", "localhost") or name.endswith(".localhost")
    return True


def _file(file: str, runtime: Runtime) -> tuple[bytes, Sequence[Camera]]:
    """A .tsplat file that any page decodes, as it is where it is one, and its views."""
    with within(file):
        if Path(file).suffix.lower() != SUFFIX:
            gaussians = load_gaussians(file)
            return runtime.compress(gaussians, qp=FINE_QP), gaussians.cameras
        data = read_limited(file, MAX_FILE_BYTES)
        container = read_container(data)
        if isinstance(container.body, Photos):
            data = runtime.compress(runtime.decompress(data))
        return data, container.cameras


def _photos(scene: Scene, cameras: Sequence[Camera], told: Told) -> dict[int, NDArray]:
    """Photos of the views that a scene's frames were taken from, by view.

    Raises:
        InputError: no frame belongs to any view.
    """
    photos: dict[int, NDArray] = {}
    reach = max(_reach_of(cameras), 1e-9)
    for i, camera in enumerate(told.progress("reading photos", cameras)):
        photo = _taken_as(camera, scene, reach)
        if photo is not None:
            own = scene.frames[photo].camera
            most = max(own.height / camera.height, own.width / camera.width, 1.0)
            scale = min(most, max(math.sqrt(MOST_PHOTO / (camera.height * camera.width)), 1.0))
            photos[i] = scene.frames[photo].resized(round(scale * camera.height), round(scale * camera.width)).image()
    if not photos:
        raise InputError("no photo was taken from any of the file's views", where=str(scene.path))
    return photos


_SAME_PLACE = 1e-3
"""Largest distance of a photo's camera from a view's, as a share of `_reach_of` the views, and largest difference of
their rotations' entries."""


def _reach_of(cameras: Sequence[Camera]) -> float:
    """The greatest distance between two of the cameras, in scene units."""
    centres = np.stack([camera.centre for camera in cameras])
    return float(np.linalg.norm(centres[:, None] - centres, axis=-1).max())


def _taken_as(view: Camera, scene: Scene, reach: float) -> int | None:
    """The photo that a view was taken as, if any.

    Args:
        view: whose pose is looked for.
        scene: the photos.
        reach: of all views.
    """
    away = [float(np.linalg.norm(frame.camera.centre - view.centre)) for frame in scene.frames]
    turned = [float(np.abs(frame.camera.rotation - view.rotation).max()) for frame in scene.frames]
    fits = [i for i in range(len(away)) if away[i] <= _SAME_PLACE * reach and turned[i] <= _SAME_PLACE]
    return min(fits, key=away.__getitem__, default=None)
