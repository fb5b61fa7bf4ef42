"""tsplat.js in Chromium: with workers and without, from a stream, and aborted; against the runtime."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from page.browser import Browser, Folder, Tab, served
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.web import bundled

WEB = Path(ts.__file__).parent / "web"

PAGE = """<!doctype html><link rel="icon" href="data:,"><script type="module">
import * as tsplat from "/web/tsplat.js";
const bytes = await (await fetch("/scene.tsplat")).arrayBuffer();
const sums = (array) => [...array.slice(0, 200), array.reduce((sum, value) => sum + value, 0)];
const told = ({ count, means, quats, scales, opacities, sh }) =>
  ({ count, means: sums(means), quats: sums(quats), scales: sums(scales), opacities: sums(opacities), sh: sums(sh) });
Object.assign(window, { tsplat, bytes, told, started: 0 });
const { Worker } = window;
window.Worker = class extends Worker { constructor(...given) { super(...given); window.started++; } };
window.isReady = true;
</script>"""


class Handler(Folder):
    """A folder, and below /web the decoder."""

    def translate_path(self, path: str) -> str:
        return str(WEB / path.removeprefix("/web/")) if path.startswith("/web/") else super().translate_path(path)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    (folder / "index.html").write_text(PAGE)
    (folder / "scene.tsplat").write_bytes(ts.compress(make_smooth_gaussians(2, 96, 96, 1, layers=2), "fast", -6))
    return folder


@pytest.fixture(scope="module")
def tab(scene: Path) -> Iterator[Tab]:
    with Browser() as browser, served(scene, Handler) as address:
        opened = browser.open(f"{address}/index.html", 64, 64)
        opened.wait("window.isReady")
        yield opened
        assert browser.messages == []


def check(said: dict[str, list[float]], wanted: ts.Gaussians) -> None:
    """Fail where the first numbers or the sum of an array are not the runtime's."""
    flat = wanted.flat()
    assert said["count"] == flat.count
    for name in FIELDS:
        array = getattr(flat, name).ravel()
        largest, found = float(np.abs(array).max()), np.array(said[name])
        assert np.abs(found[:-1] - array[:200]).max() <= 1e-5 * largest
        assert abs(found[-1] - array.sum(dtype=np.float64)) <= 2e-6 * largest * array.size


@pytest.mark.parametrize("threads", ["0", "3", "undefined"])
def test_a_file_decodes_on_workers_and_without(tab: Tab, scene: Path, threads: str) -> None:
    wanted = ts.decompress((scene / "scene.tsplat").read_bytes())
    tab.evaluate("window.isReady = false")
    tab.send("Page.reload")
    tab.wait("window.isReady")
    often = "let scene; for (let sum = 0; sum < 1 << 20; sum += bytes.byteLength)"  # until workers are worth it
    script = f"{often} scene = await tsplat.decode(bytes, {{threads: {threads}}}); return told(scene);"
    check(tab.evaluate(f"(async () => {{ {script} }})()"), wanted)
    started, processors = tab.evaluate("[window.started, navigator.hardwareConcurrency]")
    assert started == 0 if threads == "0" else 0 < started <= (processors if threads == "undefined" else 3)


def test_the_bundle_decodes_from_a_blob(tab: Tab, scene: Path) -> None:
    script = f"import(URL.createObjectURL(new Blob([{json.dumps(bundled())}], {{type: 'text/javascript'}})))"
    said = tab.evaluate(f"{script}.then((own) => own.decode(bytes, {{threads: 2}})).then(told)")
    check(said, ts.decompress((scene / "scene.tsplat").read_bytes()))


STREAM = """(async () => {
  const said = [], { steps } = tsplat.inspect(bytes);
  let seen = () => {};
  const chunks = (async function* () {
    let at = 0;
    for (const step of steps) {
      const shown = new Promise((done) => (seen = done));
      yield new Uint8Array(bytes.slice(at, step));
      at = step;
      if (step < bytes.byteLength) await shown; // what is there has been taken
    }
  })();
  const pictures = new Map();
  const onPicture = (name) => pictures.set(name, (pictures.get(name) ?? 0) + 1);
  for await (const scene of tsplat.decodeStream(chunks, { onPicture })) {
    said.push({ ...told(scene), received: scene.received });
    seen();
  }
  return { said, steps, most: Math.max(...pictures.values()), pictures: pictures.size };
})()"""


def test_a_stream_gives_ever_better_scenes_and_decodes_no_picture_twice(tab: Tab, scene: Path) -> None:
    data = (scene / "scene.tsplat").read_bytes()
    found = tab.evaluate(STREAM)
    received = [entry["received"] for entry in found["said"]]
    assert received == found["steps"]
    assert received[0] < len(data)
    check(found["said"][-1], ts.decompress(data))
    assert found["most"] == 1
    pictures = sum(len(plane.get("bytes_by_view", [])) for plane in ts.inspect(data)["planes"])
    assert found["pictures"] == pictures


ABORT = """(async () => {
  const stop = new AbortController();
  const onPicture = () => stop.abort();
  let error;
  const options = { signal: stop.signal, threads: THREADS, onPicture };
  await tsplat.decode(bytes, options).catch((caught) => (error = caught.name));
  return [error, (await tsplat.decode(bytes, { threads: THREADS })).count];
})()"""


@pytest.mark.parametrize("threads", [0, 2])
def test_decoding_stops_when_it_is_told_to_and_works_on_after_that(tab: Tab, scene: Path, threads: int) -> None:
    count = ts.decompress((scene / "scene.tsplat").read_bytes()).count
    assert tab.evaluate(ABORT.replace("THREADS", str(threads))) == ["AbortError", count]
