"""Stories are read whole or refused by their field; pages show, change and save them, and run nothing of theirs."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from console import fail, succeed, tinysplat
from page.browser import Browser, Tab, picture
from scenes import make_smooth_gaussians, psnr, tells

import tinysplat_runtime as ts
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.page.build import PageContent, scene_files, scene_page
from tinysplat_runtime.page.story import load_story

MARKUP = "<img src=x onerror=alert(1)></script><b>"
VIEWS = [
    {"title": "All of it", "text": "From the front.", "view": "0,0,0,0,0"},
    {"title": MARKUP, "text": "", "view": "0.05,0,0.05,1,-1,1,1.2"},
]
STORY: dict[str, Any] = {
    "seconds": 0,
    "views": VIEWS,
    "notes": [{"at": [0, 0, 1], "text": MARKUP}, {"at": [0, 0, 90], "text": "behind"}],
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as running:
        yield running
        assert [message for message in running.messages if "ReadPixels" not in message] == []


@pytest.fixture(scope="module")
def data() -> bytes:
    return ts.compress(make_smooth_gaussians(2, 48, 64), qp=-6)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"views": [{"title": 3, "view": "0,0,0,0,0"}]}, "views[0].title"),
        ({"views": [{"title": "x" * 121, "view": "0,0,0,0,0"}]}, "views[0].title 121 120"),
        ({"views": [{"title": "a\u202eb", "view": "0,0,0,0,0"}]}, "views[0].title U+202E"),
        ({"views": [{"view": "0,0,0,nan,0"}]}, "views[0].view 0,0,0,nan,0"),
        ({"views": [{"view": "0,0,0,0,0,0,99"}]}, "views[0].view 0,0,0,0,0,0,99"),
        ({"views": [{"view": "0,0"}]}, "views[0].view 0,0"),
        ({"views": [{}]}, "views[0].view"),
        ({"views": [VIEWS[0]] * 201}, "views 201 200"),
        ({"views": {}}, "views object"),
        ({"notes": [{"at": [0, 0, 1], "text": ""}] * 1001}, "notes 1001 1000"),
        ({"notes": [{"at": [0, 0], "text": ""}]}, "notes[0].at"),
        ({"notes": [{"at": [0, 0, 1e16], "text": ""}]}, "notes[0].at"),
        ({"seconds": -1}, "seconds -1"),
        ({"seconds": "soon"}, "seconds soon"),
    ],
)
def test_what_is_no_story_is_refused_by_its_field(tmp_path: Path, change: dict[str, Any], fault: str) -> None:
    (tmp_path / "s.json").write_text(json.dumps(STORY | change))
    with pytest.raises(InputError) as caught:
        load_story(tmp_path / "s.json")
    assert tells(str(caught.value), f"{tmp_path / 's.json'} {fault}")


def test_a_story_of_another_scene_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "g.tsplat").write_bytes(data)
    (tmp_path / "s.json").write_text(json.dumps(STORY))
    (tmp_path / "far.json").write_text(json.dumps({"views": [{"view": "5000,0,0,0,0"}]}))
    page = ("view", tmp_path / "g.tsplat", "--html", tmp_path / "p.html", "--story")
    assert tells(fail(*page, tmp_path / "far.json"), f"{tmp_path / 'far.json'}")
    assert "missing.json" in fail(*page, tmp_path / "missing.json")
    assert tinysplat(*page, tmp_path / "s.json").returncode == 0 and MARKUP not in (tmp_path / "p.html").read_text()


def test_pages_without_a_story_have_nothing_of_it(data: bytes) -> None:
    plain, told = (PageContent("scene"), PageContent("scene", story=STORY))
    assert len(scene_page(data, told)) - len(scene_page(data, plain)) > 3000
    assert "story" not in scene_page(data, plain).partition('id="code"')[0]
    assert {"story.js"} == set(scene_files(data, told)) - set(scene_files(data, plain))


def opened(browser: Browser, file: Path, width: int = 1280, height: int = 800, ratio: float = 1) -> Tab:
    tab = browser.open(file.as_uri(), width, height, ratio=ratio)
    tab.ready()
    return tab


@pytest.mark.parametrize(("width", "height", "ratio"), [(1280, 800, 1), (390, 844, 3)])
def test_a_visitor_goes_through_a_story(
    browser: Browser, tmp_path: Path, data: bytes, width: int, height: int, ratio: float
) -> None:
    (tmp_path / "p.html").write_text(scene_page(data, PageContent("scene", story=STORY)))
    tab = opened(browser, tmp_path / "p.html", width, height, ratio)
    bar = "document.querySelector('#story')"
    assert "All of it From the front." in tab.evaluate(f"{bar}.innerText")
    tab.evaluate(f"{bar}.querySelector('[aria-label=\"The next view\"]').click()")
    tab.wait("!page.flight")
    tab.ready()
    assert MARKUP in tab.evaluate(f"{bar}.textContent") and not tab.evaluate("document.querySelector('main b, nav b')")
    box = tab.evaluate(f"(({{ left, right, bottom }}) => [left, right, bottom])({bar}.getBoundingClientRect())")
    assert 0 <= box[0] < box[1] <= width and box[2] <= height
    tab.wait("document.querySelectorAll('.note')[1].matches('.behind, [hidden]')")
    tab.wait("!document.querySelector('.note').matches('.behind, [hidden]')")
    tab.close()


def test_a_story_plays_by_itself_and_stops_at_a_touch(browser: Browser, tmp_path: Path, data: bytes) -> None:
    (tmp_path / "p.html").write_text(scene_page(data, PageContent("scene", story=STORY | {"seconds": 1})))
    tab = browser.open((tmp_path / "p.html").as_uri(), 640, 480, moves=True)
    title = "document.querySelector('#story strong')?.textContent"
    tab.wait(f"{title}?.startsWith('<img')")
    tab.wait(f"{title} === 'All of it'")
    tab.drag(320, 200, 30, 0)
    assert tab.evaluate("document.querySelector('#story [aria-label=Play]') !== null")
    tab.close()


def test_a_film_stops_at_the_views_that_a_page_showed(browser: Browser, tmp_path: Path) -> None:
    scene = make_smooth_gaussians(2, 48, 64)
    scene = replace(scene, cameras=tuple(replace(camera, K=scene.cameras[0].K) for camera in scene.cameras))
    (tmp_path / "g.tsplat").write_bytes(ts.compress(scene, qp=-6))
    page = PageContent("scene", background=(0, 0, 0))
    (tmp_path / "p.html").write_text(scene_page((tmp_path / "g.tsplat").read_bytes(), page))
    tab, seen, views = opened(browser, tmp_path / "p.html", 320, 240), [], []
    for across, zoom in ((60, 1), (-90, 1.5)):
        tab.drag(160, 120, across, 5)
        tab.evaluate(f"page.camera.zoom = {zoom}, page.move(), 0")
        tab.wait("!page.mover.spring(0) && location.hash.includes('view=')")
        tab.ready()
        seen.append(picture(tab))
        views.append({"view": tab.evaluate("location.hash").partition("view=")[2]})
    tab.close()
    (tmp_path / "s.json").write_text(json.dumps({"seconds": 1, "views": views}))
    words = ("render", tmp_path / "g.tsplat", "-o", tmp_path / "film.mp4", "--story", tmp_path / "s.json")
    succeed(*words, "--size", "320x240")
    with av.open(str(tmp_path / "film.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24") / 255 for frame in film.decode(video=0)]
    assert len(frames) == 60
    for frame, wanted in zip((frames[0], frames[-1]), seen, strict=True):
        assert psnr(frame[60:180, 80:240], wanted[60:180, 80:240]) > 27
    assert tells(fail(*words, "--path", "orbit", "--force"), "--story --path")
    (tmp_path / "s.json").write_text("{}")
    assert tells(fail(*words, "--force"), f"{tmp_path / 's.json'} views")


def test_a_story_is_made_on_the_page_and_saved_as_the_page(browser: Browser, tmp_path: Path, data: bytes) -> None:
    """What is saved opens again, with what was made, and `view --story` takes the file."""
    (tmp_path / "p.html").write_text(
        scene_page(data, PageContent("scene", story={"seconds": 0, "views": [], "notes": []}))
    )
    tab = opened(browser, tmp_path / "p.html", 640, 480)
    assert tab.evaluate("document.querySelector('#story').hidden")
    tab.evaluate("""{
      globalThis.kept = [];
      URL.createObjectURL = (blob) => (kept.push(blob.text()), 'blob:none');
      HTMLAnchorElement.prototype.click = () => 0;
      const buttons = [...document.querySelectorAll('#editor button')];
      const press = (text) => buttons.find((one) => one.textContent === text).click();
      const fill = (name, text) => { document.querySelector(`#editor [name=${name}]`).value = text; };
      fill('title', 'A <i>corner</i>'); fill('text', 'as it was');
      press('Add this view');
      fill('title', 'Second'); fill('text', '');
      press('Add this view');
      press('←');
      fill('note', 'here');
      press('Add the note');
      press('Save the story');
      press('Save the page');
    }""")
    told, page = tab.evaluate("Promise.all(kept)")
    tab.close()
    (tmp_path / "s.json").write_text(told)
    story = load_story(tmp_path / "s.json").document
    assert [view["title"] for view in story["views"]] == ["Second", "A <i>corner</i>"]
    depth = make_smooth_gaussians(2, 48, 64).means[..., 2]
    assert depth.min() - 1 < story["notes"][0]["at"][2] < depth.max() + 1 and np.isfinite(story["notes"][0]["at"]).all()
    (tmp_path / "again.html").write_text(page)
    tab = opened(browser, tmp_path / "again.html", 640, 480)
    assert tab.evaluate("document.querySelector('#story strong').textContent") == "Second"
    assert tab.evaluate("document.querySelectorAll('.note').length") == 1
    tab.close()
