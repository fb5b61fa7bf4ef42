"""The whole page in Chromium: its pictures are the rasteriser's, and it keeps a visitor near the views."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from page.browser import Browser, Folder, Tab, picture, served
from scenes import make_smooth_gaussians, psnr

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.editing import crop
from tinysplat_runtime.page.build import PageContent, player_page, scene_files, scene_page
from tinysplat_runtime.page.front import front_view

LEAST_DB = 40.0
MIDDLE = np.s_[80:160, 110:210]  # of 320x240, whose margins are those of where a visitor came from


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as running:
        yield running
        assert [message for message in running.messages if "ReadPixels" not in message] == []  # of our own reading


def coded(views: int, degree: int = 1, height: int = 48, width: int = 64) -> bytes:
    scene = make_smooth_gaussians(views, height, width, degree=degree, layers=2, origin=np.array([1e5, -3e5, 0.0]))
    return ts.compress(scene, qp=-6)


@pytest.mark.parametrize(("views", "degree"), [(2, 0), (8, 1), (3, 2), (2, 3), (4, 4)])
def test_pictures_at_views_are_the_rasteriser_s(browser: Browser, tmp_path: Path, views: int, degree: int) -> None:
    data = coded(views, degree)
    gaussians = ts.decompress(data)
    (tmp_path / "page.html").write_text(scene_page(data, PageContent("a <b>")))
    for view, times in ((0, 1), (1, 2)):
        camera = gaussians.cameras[view].resized(times * 48, times * 64)
        tab = browser.open(f"{(tmp_path / 'page.html').as_uri()}#bare&camera={view}", camera.width, camera.height)
        tab.ready()
        assert psnr(picture(tab), ts.render(gaussians, camera).clip(0, 1)) > LEAST_DB
        tab.close()


def test_gaussians_of_no_pixels_are_seen_from_outside(browser: Browser, tmp_path: Path) -> None:
    data = ts.compress(replace(ts.decompress(coded(2, degree=2)).flat(), viewpoints=()), qp=-6)
    (tmp_path / "page.html").write_text(scene_page(data, PageContent("list")))
    tab = browser.open(f"{(tmp_path / 'page.html').as_uri()}#bare", 320, 240)
    tab.ready()
    assert picture(tab).max() > 0.2
    assert tab.evaluate("document.getElementById('free').closest('label').hidden")  # nothing holds one back
    tab.close()


def test_a_visitor_stays_near_the_views_and_comes_back(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(
        scene_page(coded(2), PageContent("scene", photos={0: np.full((48, 64, 3), 0.5)}))
    )
    tab = browser.open((tmp_path / "page.html").as_uri(), 390, 844)
    tab.ready()
    hidden = "['panel', 'back'].map((id) => document.getElementById(id).hidden)"
    assert tab.evaluate(hidden) == [False, True]
    assert "2 photos" in tab.evaluate("document.getElementById('caption').textContent")
    start = picture(tab)
    tab.drag(195, 420, 150, 40)
    tab.wait("page.bound.strain(page.camera) < 1.01 && !page.mover.spring(0)")
    tab.ready()
    assert np.abs(picture(tab) - start).mean() > 1e-3
    assert not tab.evaluate("document.getElementById('back').hidden")
    tab.evaluate("document.getElementById('back').click()")
    tab.wait("page.bound.strain(page.camera) < 1e-6")
    tab.ready()
    assert np.abs(picture(tab) - start).mean() < 1e-3
    tab.close()


def test_a_visitor_goes_from_place_to_place(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(scene_page(coded(8, height=24, width=32), PageContent("walk", first=5)))
    tab = browser.open((tmp_path / "page.html").as_uri(), 320, 240)
    tab.ready()
    at = "[page.current, place.value, placeOf.textContent, before.disabled, after.disabled]"
    order = tab.evaluate("page.order")
    assert sorted(order) == list(range(8))
    assert tab.evaluate(at)[0] == 5
    tab.evaluate("place.value = 1, place.oninput(), 0")
    tab.wait("!page.flight")
    current, place, told, *ends = tab.evaluate(at)
    assert [current, place, *ends] == [order[0], "1", True, False] and "1" in told and "8" in told
    for place in order[1:]:
        tab.evaluate("after.click()")
        tab.wait("!page.flight")
        assert tab.evaluate("page.current") == place
    assert tab.evaluate(at)[3:] == [False, True]
    tab.evaluate("back.click()")
    tab.wait("!page.flight && page.current === 5")
    for _ in range(12):  # drags on and on reach another place
        tab.drag(160, 120, 150, 0)
        tab.wait("!page.flight && !page.mover.spring(0)")
        if tab.evaluate("page.current") != 5:
            break
    assert tab.evaluate("page.current") != 5
    tab.close()


def test_a_length_is_measured_between_two_clicks(browser: Browser, tmp_path: Path) -> None:
    for unit, said in (("metre", "m ±"), ("", "--length=")):
        scene = make_smooth_gaussians(2, 48, 64)
        data = ts.compress(scene, qp=-6, unit=unit)
        gaussians = ts.decompress(data)
        (tmp_path / "page.html").write_text(scene_page(data, PageContent("scene", first=0)))
        tab = browser.open((tmp_path / "page.html").as_uri(), 640, 480)
        tab.ready()
        tab.evaluate("measure.click()")
        for x in (200, 440):
            tab.drag(x, 240, 0, 0)
        text = tab.wait("found.textContent.includes('±') && found.textContent")
        assert said in text
        depth = ts.render(gaussians, gaussians.cameras[0], outputs=("depth",))["depth"]
        ends = []
        for u in (20, 44):
            ray = np.linalg.solve(gaussians.cameras[0].K, (u, 24, 1)) * depth[24, u]
            ends.append(ray @ gaussians.cameras[0].rotation + gaussians.cameras[0].centre)
        apart = float(np.linalg.norm(ends[1] - ends[0]))
        assert abs(float(text.split()[0]) - apart) < 0.05 * apart
        if not unit:
            (tmp_path / "g.tsplat").write_bytes(data)
            option = text.split()[-1].replace("0.74m", "2m")
            ts.convert(tmp_path / "g.tsplat", tmp_path / "g.ply", length=option.partition("=")[2])
            assert ts.load_gaussians(tmp_path / "g.ply").notes.unit == "metre"
        tab.evaluate("measure.click()")
        assert tab.evaluate("found.hidden && !document.querySelector('#overlay *')")
        tab.close()


def test_a_box_is_dragged_and_says_how_to_crop(browser: Browser, tmp_path: Path) -> None:
    data = coded(2)
    gaussians = ts.decompress(data)
    (tmp_path / "page.html").write_text(scene_page(data, PageContent("scene", first=0)))
    for width, height in ((1280, 800), (390, 844)):
        tab = browser.open((tmp_path / "page.html").as_uri(), width, height)
        tab.ready()
        tab.evaluate("crop.click()")
        before = corners(tab)
        kept = crop(gaussians, *before).count
        assert 0.5 * gaussians.count < kept < gaussians.count
        handle = "overlay.querySelectorAll('[tabindex]')[{}]"
        spot = tab.evaluate(f"[...'xy'].map((k) => Number({handle.format(1)}.getAttribute('c' + k)))")
        tab.drag(*spot, -20, 0)
        after = corners(tab)
        assert after[1, 0] < before[1, 0] and (np.delete(after, 3) == np.delete(before, 3)).all()
        tab.evaluate(f"{handle.format(2)}.focus(), 0")
        tab.send("Input.dispatchKeyEvent", type="keyDown", code="ArrowUp", key="ArrowUp")
        assert corners(tab)[0, 1] > after[0, 1]
        tab.close()


def corners(tab: Tab) -> NDArray:
    """(2, 3) of the box that the page says to crop to."""
    text = tab.evaluate("found.textContent")
    return np.array(text.partition("--crop=")[2].split(","), float).reshape(2, 3)


OPEN = """() => {
  const send = Worker.prototype.postMessage; // an order is always late, as it is of many Gaussians
  Worker.prototype.postMessage = function (...given) { setTimeout(() => send.apply(this, given), 100); };
  const { splats } = page, draw = splats.draw.bind(splats), noted = (globalThis.noted = []);
  splats.draw = (...given) => {
    draw(...given);
    const { gl, target: { frame, width, height } } = splats, [w, h] = [width >> 1, height >> 1];
    const pixels = new Float32Array(4 * w * h), place = [(width - w) >> 1, (height - h) >> 1, w, h];
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(...place, gl.RGBA, gl.FLOAT, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    noted.push(pixels.filter((_, i) => i % 4 === 3).reduce((sum, open) => sum + (open > 0.5), 0) / (w * h));
  };
}"""


@pytest.mark.parametrize(("moves", "apart"), [(False, 2.5), (True, 0.6)], ids=["jumps", "flights"])
def test_no_frame_on_the_way_to_other_places_has_holes(
    browser: Browser, tmp_path: Path, moves: bool, apart: float
) -> None:
    scene = make_smooth_gaussians(16, 24, 32, degree=0)
    right = apart * np.arange(16)[:, None, None] * np.eye(4)[:, [3]] @ np.eye(4)[[0]]  # where jumps lead, all is new
    cameras = [replace(camera, c2w=camera.c2w + step.T) for camera, step in zip(scene.cameras, right, strict=True)]
    means = scene.means + np.float32(apart * np.arange(16)[:, None, None, None] * np.eye(3)[0])
    data = ts.compress(replace(scene, means=means, cameras=tuple(cameras)), qp=-6)
    (tmp_path / "page.html").write_text(scene_page(data, PageContent("walk")))
    tab = browser.open((tmp_path / "page.html").as_uri(), 96, 72, moves=moves)
    tab.wait("globalThis.page && page.splats")
    tab.evaluate("page.swing(false), 0")  # a page that moves by itself is ready for a moment at a time
    tab.wait("'ready' in document.body.dataset")
    tab.evaluate(f"({OPEN})()")
    for n in range(10):
        drawn = tab.evaluate("noted.length")
        tab.evaluate("after.click(), 0")
        tab.drag(48, 36, 60 * (-1) ** n, 0, steps=3)
        tab.wait(f"noted.length > {drawn}")
    tab.wait("!page.flight && !page.mover.spring(0)")
    tab.ready()
    assert max(tab.evaluate("noted")) < 0.02
    tab.close()


def test_a_link_leads_to_the_same_view(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(scene_page(coded(3), PageContent("scene")))
    tab = browser.open((tmp_path / "page.html").as_uri(), 320, 240)
    tab.ready()
    assert "view" not in tab.evaluate("location.hash")
    tab.drag(160, 120, 60, 5)
    tab.wait("!page.mover.spring(0) && location.hash.includes('view=')")
    tab.ready()
    seen, address = picture(tab)[MIDDLE], tab.evaluate("location.href")
    counted = [tab.evaluate("placeOf.textContent")]
    tab.close()
    tab = browser.open(address, 320, 240)
    tab.ready()
    assert psnr(picture(tab)[MIDDLE], seen) > LEAST_DB
    counted.append(tab.evaluate("placeOf.textContent"))
    assert counted[0] == counted[1] and tab.evaluate("place.ariaValueText") == counted[0].replace("/", "of")
    tab.evaluate("location.hash = '#view=' + location.hash.slice(6).replace(/^[^,]*/, (x) => Number(x) + 0.02), 0")
    tab.wait("'ready' in document.body.dataset")
    tab.ready()
    assert psnr(picture(tab)[MIDDLE], seen) < LEAST_DB
    tab.evaluate("history.back(), 0")
    tab.wait(f"location.href === {address!r} && 'ready' in document.body.dataset")
    tab.ready()
    assert psnr(picture(tab)[MIDDLE], seen) > LEAST_DB
    tab.evaluate("globalThis.device = page.splats.gl.getExtension('WEBGL_lose_context'), device.loseContext(), 0")
    tab.wait("!page.splats")  # as phones do to a tab that nobody looks at
    tab.evaluate("device.restoreContext(), 0")
    tab.wait("page.splats && 'ready' in document.body.dataset")
    tab.ready()
    assert psnr(picture(tab)[MIDDLE], seen) > LEAST_DB
    tab.close()


def test_what_moves_by_itself_is_linked_to_as_it_shows_and_compared_at_a_photo_s_place(
    browser: Browser, tmp_path: Path
) -> None:
    photos = dict(enumerate(np.full((48, 64, 3), level) for level in (0.2, 0.5, 0.8)))
    (tmp_path / "page.html").write_text(scene_page(coded(3), PageContent("scene", photos=photos)))
    tab = browser.open((tmp_path / "page.html").as_uri(), 320, 240, moves=True)
    moves = "(page.isSwinging || page.swing(true), page.nearest()[0] !== page.start)"  # slow machines end it
    tab.wait(f"globalThis.page && page.scene && !panel.hidden && {moves}")
    tab.evaluate("navigator.clipboard.writeText = async (text) => { globalThis.written = text; }, link.click(), 0")
    assert "#view=" in tab.evaluate("written")
    key = {"key": "c", "code": "KeyC", "windowsVirtualKeyCode": 67}
    tab.send("Input.dispatchKeyEvent", type="keyDown", **key)
    assert tab.evaluate("[photo.hidden, page.isSwinging]") == [False, False]
    tab.send("Input.dispatchKeyEvent", type="keyUp", **key)
    assert tab.evaluate("photo.hidden")
    tab.wait("!page.flight && page.nearest()[0] === page.current")
    tab.close()


def test_a_page_within_another_waits_for_a_tap(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(scene_page(coded(2), PageContent("scene", poster=np.full((48, 64, 3), 0.5))))
    frame = '<iframe src="page.html#embed" style="width: 300px; height: 200px"></iframe>'
    (tmp_path / "article.html").write_text(f'<!doctype html><link rel="icon" href="data:,">{frame}')
    with served(tmp_path) as address:
        tab = browser.open(f"{address}/article.html", 320, 240)
        tab.wait("frames[0]?.document.getElementById('begin')?.hidden === false")
        assert not tab.evaluate("'page' in frames[0] && Boolean(frames[0].page.scene)")
        tab.evaluate("frames[0].document.getElementById('begin').click(), 0")
        tab.wait("'ready' in frames[0].document.body.dataset")
        shown = "['hint', 'panel'].map((id) => frames[0].document.getElementById(id).checkVisibility())"
        assert tab.evaluate(shown) == [False, False]
        assert tab.evaluate("frames[0].getComputedStyle(frames[0].view).touchAction") == "pan-y"
        tab.close()


class Strict(Folder):
    """A folder on a site that allows what is its own alone."""

    def end_headers(self) -> None:
        """With the site's policy."""
        self.send_header("Content-Security-Policy", "default-src 'self'")
        super().end_headers()


def test_strict_sites_show_a_folder_and_a_page_says_what_it_lacks(browser: Browser, tmp_path: Path) -> None:
    data, poster = coded(8, height=24, width=32), np.full((24, 32, 3), 0.5)
    for name, content in scene_files(data, PageContent("scene", photos={0: poster}, poster=poster)).items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "page.html").write_text(scene_page(data, PageContent("scene")))
    with served(tmp_path, Strict) as address:
        before = len(browser.messages)
        tab = browser.open(f"{address}/index.html#bare", 32, 24)
        tab.ready()
        assert [message for message in browser.messages[before:] if "ReadPixels" not in message] == []
        gaussians = ts.decompress(data)
        assert psnr(picture(tab), ts.render(gaussians, gaussians.cameras[0]).clip(0, 1)) > LEAST_DB
        tab.close()
        tab = browser.open(f"{address}/page.html", 320, 240)
        tab.wait("document.getElementById('blocked')?.checkVisibility()")
        text = tab.evaluate("document.body.innerText")
        assert "Loading" not in text and "Content-Security-Policy" in text and "--files" in text
        tab.close()
    browser.messages[:] = [message for message in browser.messages if "Content Security Policy" not in message]


def test_of_a_cut_file_a_page_says_what_it_shows(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "player.html").write_text(player_page())
    data = coded(24)
    (tmp_path / "cut.tsplat").write_bytes(data[: len(data) * 2 // 3])
    with served(tmp_path) as address:
        tab = browser.open(f"{address}/player.html?file=cut.tsplat", 390, 844)
        tab.ready()
        words = tab.wait("fault.checkVisibility() && fault.textContent")
        assert "cut short" in words
        assert tab.evaluate("panel.checkVisibility() && fault.getBoundingClientRect().top > innerHeight / 2")
        assert picture(tab).std() > 0.02
        tab.close()


def test_a_poster_is_shown_before_the_scene(browser: Browser, tmp_path: Path) -> None:
    page = scene_page(coded(2), PageContent("scene", poster=np.full((48, 64, 3), (0.9, 0.1, 0.1))))
    (tmp_path / "page.html").write_text(page)
    tab = browser.open((tmp_path / "page.html").as_uri(), 320, 240)
    tab.wait("document.getElementById('poster')?.naturalWidth > 0")
    tab.ready()
    assert tab.evaluate("getComputedStyle(cover).visibility") == "hidden" or tab.wait(
        "cover.classList.contains('done')"
    )
    tab.close()


def test_switches_change_the_picture_and_back(browser: Browser, tmp_path: Path) -> None:
    photo = np.full((48, 64, 3), 0.5)
    (tmp_path / "page.html").write_text(scene_page(coded(3), PageContent("scene", photos={0: photo})))
    tab = browser.open((tmp_path / "page.html").as_uri(), 160, 120)
    tab.ready()
    tab.evaluate("page.camera.shift(0.2, 0.1, -0.6), page.move(), 0")  # from where the cameras are seen
    tab.ready()
    before = picture(tab)
    hidden = [f"opacity.value = {value}, opacity.oninput()" for value in (0.9, 0)]
    for change, undone in (("depth.click()", "depth.click()"), hidden):
        tab.evaluate(f"{change}; 0")
        tab.ready()
        assert np.abs(picture(tab) - before).mean() > 1e-3, change
        tab.evaluate(f"{undone}; 0")
        tab.ready()
        np.testing.assert_array_equal(picture(tab), before, err_msg=undone)
    hold = "dispatchEvent(new KeyboardEvent('WAY', { code: 'KeyC' })), [photo.hidden, compareRow.hidden]"
    assert tab.evaluate(hold.replace("WAY", "keydown")) == [False, False]
    assert tab.evaluate(hold.replace("WAY", "keyup")) == [True, False]
    tab.evaluate("after.click(), 0")  # of that place there is no photo
    assert tab.evaluate(hold.replace("WAY", "keydown")) == [True, True]
    freed = "[fliesRow.hidden, (free.click(), fliesRow.hidden), (flies.click(), page.free.flies)]"
    assert tab.evaluate(freed) == [True, False, True] and tab.evaluate("free.click(), fliesRow.hidden")
    texts = tab.evaluate("[summary.textContent, caption.textContent]")
    assert f"{ts.decompress(coded(3)).count:,}" in texts[0] and "gaussians" in texts[0] and "3" in texts[1]
    tab.close()


# ---- the player ----------------------------------------------------------------------------------------------------


def test_the_player_opens_what_is_linked(browser: Browser, tmp_path: Path) -> None:
    data = coded(2)
    gaussians = ts.decompress(data)
    (tmp_path / "player.html").write_text(player_page())
    (tmp_path / "a b.tsplat").write_bytes(data)
    camera = gaussians.cameras[front_view(gaussians.cameras)]  # as a page of the same file begins
    with served(tmp_path) as address:
        tab = browser.open(f"{address}/player.html?file=a%20b.tsplat&bare", camera.width, camera.height)
        tab.ready()
        assert psnr(picture(tab), ts.render(gaussians, camera).clip(0, 1)) > LEAST_DB
        assert tab.evaluate("document.title") == "a b"
        tab.close()


def test_the_player_opens_what_is_dropped_and_refuses_what_is_none(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "player.html").write_text(player_page())
    tab = browser.open((tmp_path / "player.html").as_uri(), 300, 200)
    tab.wait("globalThis.page && !document.getElementById('open').hidden")
    drop = """(bytes) => {
      const files = new DataTransfer();
      files.items.add(new File([Uint8Array.from(bytes)], "scene.tsplat"));
      dispatchEvent(new DragEvent("drop", { dataTransfer: files, bubbles: true, cancelable: true }));
    }"""
    tab.evaluate(f"({drop})({list(coded(2))})")
    tab.ready()
    assert picture(tab).std() > 0.02
    assert tab.evaluate("[document.title, document.getElementById('open').hidden]") == ["scene", True]
    tab.evaluate(f"({drop})([1, 2, 3, 4])")
    tab.wait("document.getElementById('fault').textContent")
    assert not tab.evaluate("document.getElementById('fault').hidden")
    assert tab.evaluate("document.getElementById('panel').hidden") and picture(tab).max() == 0
    data = coded(2)
    fault = "document.getElementById('fault').textContent"
    for foreign in ([0x1F, 0x8B, 8, 0], list(b"<!DOCTYPE html>"), list(data[: len(data) // 2])):
        before = tab.evaluate(fault)
        tab.evaluate(f"({drop})({foreign})")
        tab.wait(f"{fault} && {fault} !== {json.dumps(before)}")  # each is told in words of its own
    tab.ready()
    assert picture(tab).std() > 0.02
    browser.messages[:] = [
        message for message in browser.messages if "tsplat" not in message and "Error" not in message
    ]
    tab.close()
