"""Pages: a `.tsplat` file with the scripts that decode and draw it, as one HTML text or as a folder of files, or a
player of any such file.

Scripts are modules: those of `web/`, which decode, and those here. In one text they travel as gzip; start.js unpacks
and starts them. Bytes are written to base 85, which takes a quarter more than they do. `make page` writes smaller
scripts of the same, with shorter names (small.json.gz), which are taken for as long as they were made of today's.
"""

import base64
import gzip
import hashlib
import html
import importlib.resources
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from string import Template

from numpy.typing import NDArray

from ..scene.cameras import Camera
from ..scene.pictures import jpeg_bytes
from ..system.jsonfields import JsonObject
from ..web import bundled

_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; script-src {start} blob:; "
    "worker-src blob:; style-src {style}; img-src data: blob:; connect-src {sources}"
)

JPEG_QUANTISER = 5

_MARKUP = bytes.maketrans(b"<>&$`", b",./:[")
"""What stands for characters of RFC 1924's base 85 that mean something in HTML or in a template."""

ALLOWED = (
    "script-src 'unsafe-inline' blob:; worker-src blob:; style-src 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' blob:"
)
"""What a site's Content-Security-Policy has to allow for a page to work in it."""

FILES_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'"
)

SCENE = "scene.tsplat"
"""What a folder's scene is called."""

_ICON = "icon.svg"

STORY_STYLE = "story.css"
"""What pages with a story have beside their style."""

_START = 'import * as decoder from "./tsplat.js";\nimport { start } from "./page.js";\n'
_START_STORY = _START + 'import * as story from "./story.js";\nstart(decoder, new Uint8Array(), story);\n'
_START += "start(decoder, new Uint8Array());\n"

SMALL = "small.json.gz"
"""Smaller scripts, and what they were made of."""


@dataclass(frozen=True, eq=False)
class PageContent:
    """What a page shows beside its file.

    Attributes:
        title: heading, plain text.
        cameras: views to choose from, of a file that has none.
        photos: (H, W, 3) in [0, 1] or uint8, by index of the file's views or `cameras`.
        first: the view that the page begins at.
        poster: (H, W, 3) in [0, 1] or uint8, that view's picture, shown until the scene is drawn.
        background: colour in [0, 1] where nothing is; None for what goes with the scene's own.
        story: what `story.Story.document` is, which visitors may also change and save; None for none.
    """

    title: str
    cameras: Sequence[Camera] = ()
    photos: Mapping[int, NDArray] = field(default_factory=dict)
    first: int = 0
    poster: NDArray | None = None
    background: tuple[float, float, float] | None = None
    story: JsonObject | None = None


def scene_page(data: bytes, content: PageContent) -> str:
    """The page of one file, which loads nothing from anywhere.

    Args:
        data: a .tsplat file of a mode that needs no network, as it is.
        content: what it shows beside it.
    """
    scene = _scene(content, {i: _picture(photo) for i, photo in content.photos.items()}, None)
    poster = None if content.poster is None else _picture(content.poster)
    return _page(content.title, scene, _base85(data), sources="blob:", poster=poster)


def scene_files(data: bytes, content: PageContent) -> dict[str, bytes]:
    """As `scene_page`, as files of a folder for a web server, by name: for sites whose Content-Security-Policy allows
    scripts, styles and pictures of their own alone.
    """
    decoder, page_script, story_script = scripts()
    files = {
        SCENE: data,
        "tsplat.js": decoder.encode(),
        "page.js": page_script.encode(),
        "start.js": _START.encode(),
        "style.css": _text("style.css").encode(),
        _ICON: _text(_ICON).encode(),
    }
    if content.story is not None:
        files["story.js"] = story_script.encode()
        files["start.js"] = _START_STORY.encode()
        files["style.css"] += _text(STORY_STYLE).encode()
    pictures = {f"photo{i}.jpg": jpeg_bytes(photo, JPEG_QUANTISER) for i, photo in content.photos.items()}
    if content.poster is not None:
        pictures["poster.jpg"] = jpeg_bytes(content.poster, JPEG_QUANTISER)
    page = _filled(
        content.title,
        _scene(content, {i: f"photo{i}.jpg" for i in content.photos}, SCENE),
        policy=FILES_POLICY,
        style='<link rel="stylesheet" href="style.css">',
        code='<script type="module" src="start.js"></script>',
        icon=_ICON,
        poster=None if content.poster is None else "poster.jpg",
    )
    return {"index.html": page.encode()} | files | pictures


def player_page() -> str:
    """A page without a scene, which opens files that are dropped on it, chosen, or named by `?file=URL`."""
    return _page("TinySplat player", {"cameras": [], "photos": {}, "isPlayer": True}, "", sources="* data: blob:")


def scripts() -> tuple[str, str, str]:
    """Texts of the modules that decode, that show, and that tell, in as few bytes as there are of them."""
    texts = scripts_as_written()
    small = importlib.resources.files(__package__) / SMALL
    if small.is_file():
        made = json.loads(gzip.decompress(small.read_bytes()))
        if made["of"] == scripts_digest(texts):
            return made["decoder"], made["page"], made["story"]
    return texts


def scripts_as_written() -> tuple[str, str, str]:
    """Texts of the modules that decode, that show, and that tell, each with all that it imports."""
    return bundled(), bundled("page.js", __package__), bundled("story.js", __package__)


def scripts_digest(texts: Sequence[str]) -> str:
    """What smaller scripts say that they were made of."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def _scene(content: PageContent, photos: Mapping[int, str], source: str | None) -> dict[str, object]:
    """What the page's script is told; photos by their addresses."""
    own = [_camera(camera) for camera in content.cameras]
    said = {"cameras": own, "isPlayer": False, "first": content.first, "photos": dict(photos), "source": source}
    more = {"background": content.background, "story": content.story}
    return said | {name: value for name, value in more.items() if value is not None}


def _page(title: str, scene: Mapping[str, object], file: str, *, sources: str, poster: str | None = None) -> str:
    code = json.dumps(scripts() if "story" in scene else scripts()[:2]).encode()
    start, style = _text("start.js"), _text("style.css") + (_text(STORY_STYLE) if "story" in scene else "")
    policy = _POLICY.format(start=_hash(start), style=_hash(style), sources=sources)
    packed = _base85(gzip.compress(code, 9, mtime=0))
    return _filled(
        title,
        scene,
        policy=policy,
        style=f"<style>{style}</style>",
        code=f'<script type="application/octet-stream" id="file">{file}</script>\n'
        f'<script type="application/octet-stream" id="code">{packed}</script>\n<script>{start}</script>',
        icon="data:image/svg+xml;base64," + _base64(_text(_ICON).encode()),
        poster=poster,
    )


def _filled(
    title: str, scene: Mapping[str, object], *, policy: str, style: str, code: str, icon: str, poster: str | None
) -> str:
    return Template(_text("page.html")).substitute(
        policy=policy,
        title=html.escape(title),
        style=style,
        code=code,
        icon=icon,
        poster="" if poster is None else f'<img id="poster" alt="" src="{poster}">',
        allowed=ALLOWED,
        scene=json.dumps(scene).replace("<", "\\u003c"),  # so that no text can end the script element
    )


def _picture(image: NDArray) -> str:
    return "data:image/jpeg;base64," + _base64(jpeg_bytes(image, JPEG_QUANTISER))


def _camera(camera: Camera) -> dict[str, object]:
    """A camera as tsplat.js has them."""
    K = camera.K
    return {
        "width": camera.width,
        "height": camera.height,
        "fx": K[0, 0],
        "fy": K[1, 1],
        "cx": K[0, 2],
        "cy": K[1, 2],
        "skew": K[0, 1],
        "c2w": camera.c2w.reshape(-1).tolist(),
    }


def _hash(text: str) -> str:
    """A script or a style as Content-Security-Policy names it."""
    return f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'"


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _base85(data: bytes) -> str:
    return base64.b85encode(data).translate(_MARKUP).decode()


def _text(name: str) -> str:
    return (importlib.resources.files(__package__) / name).read_text("utf-8")
