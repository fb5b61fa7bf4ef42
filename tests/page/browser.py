"""A headless Chromium by its debugging pipe, where there is one: nothing else needs to be installed."""

from __future__ import annotations

import base64
import http.server
import io
import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-prefers-reduced-motion",
]
SECONDS = 120.0


def chromium() -> str:
    """Path of a Chromium; the test is skipped without one, but where TINYSPLAT_CHROMIUM says that there is one."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None and not os.environ.get("TINYSPLAT_CHROMIUM"):
        pytest.skip("needs Chromium: apt-get install chromium")
    assert found, "Chromium is missing"
    return found


class Folder(http.server.SimpleHTTPRequestHandler):
    """A folder of this machine's."""

    def log_message(self, format: str, *args: object) -> None:
        """Requests are nobody's concern."""


@contextmanager
def served(folder: Path, handler: type[Folder] = Folder) -> Iterator[str]:
    """The address of a folder that is served within the block."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


class Browser:
    """Chromium, for use as a context manager; `messages` is what its pages wrote to the console."""

    def __enter__(self) -> Browser:
        program = chromium()
        self._folder = tempfile.mkdtemp()
        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()
        command = [program, *FLAGS, f"--user-data-dir={self._folder}", "--remote-debugging-pipe", "about:blank"]
        script = f'exec 3<&{to_read} 4>&{to_write}; exec "$@"'  # the numbers that Chromium expects
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", *command], pass_fds=(to_read, to_write), stderr=subprocess.DEVNULL
        )
        os.close(to_read)
        os.close(to_write)
        self._held, self._ids, self.messages = b"", 0, list[str]()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._process.terminate()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
        shutil.rmtree(self._folder, ignore_errors=True)

    def send(self, method: str, session: str | None = None, **given: Any) -> dict[str, Any]:
        """The answer to a command of the DevTools protocol."""
        self._ids += 1
        command = {"id": self._ids, "method": method, "params": given} | ({"sessionId": session} if session else {})
        os.write(self._to, json.dumps(command).encode() + b"\0")
        while True:
            while b"\0" not in self._held:
                data = os.read(self._from, 1 << 20)
                assert data, "Chromium has ended"
                self._held += data
            line, _, self._held = self._held.partition(b"\0")
            said = json.loads(line)
            self._note(said)
            if said.get("id") == self._ids:
                assert "error" not in said, said
                return dict(said["result"])

    def _note(self, said: dict[str, Any]) -> None:
        match said.get("method"):
            case "Runtime.consoleAPICalled":
                self.messages.append(" ".join(str(part.get("value")) for part in said["params"]["args"]))
            case "Runtime.exceptionThrown":
                self.messages.append(str(said["params"]["exceptionDetails"]))
            case "Log.entryAdded":
                self.messages.append(said["params"]["entry"]["text"])

    def open(
        self, address: str, width: int, height: int, *, touch: bool = False, ratio: float = 1, moves: bool = False
    ) -> Tab:
        """A page in a window of so many pixels, `ratio` of the screen's each; `moves` by itself, too."""
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = Tab(self, session, target)
        for domain in ("Runtime", "Log", "Page"):
            tab.send(f"{domain}.enable")
        tab.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=touch
        )
        if moves:
            motion = {"name": "prefers-reduced-motion", "value": "no-preference"}
            tab.send("Emulation.setEmulatedMedia", features=[motion])
        tab.send("Page.navigate", url=address)
        return tab


class Tab:
    """A page that is open."""

    def __init__(self, browser: Browser, session: str, target: str) -> None:
        self._browser, self._session, self._target = browser, session, target

    def send(self, method: str, **given: Any) -> dict[str, Any]:
        """As `Browser.send`, for this page."""
        return self._browser.send(method, self._session, **given)

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression, or of the promise that it is."""
        done = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def wait(self, expression: str) -> Any:
        """The value of an expression once that is true."""
        end = time.monotonic() + SECONDS
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, f"{expression}: {self.evaluate('document.body.innerText')}"
            time.sleep(0.05)
        return value

    def ready(self) -> None:
        """Wait until the whole scene is drawn."""
        self.wait("document.body && 'whole' in document.body.dataset && 'ready' in document.body.dataset")

    def drag(self, x: float, y: float, dx: float, dy: float, steps: int = 5) -> None:
        """Press the left button at a pixel, move and let go."""
        mouse = {"button": "left", "buttons": 1, "clickCount": 1}
        self.send("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
        for i in range(1, steps + 1):
            self.send(
                "Input.dispatchMouseEvent", type="mouseMoved", x=x + dx * i / steps, y=y + dy * i / steps, **mouse
            )
        self.send("Input.dispatchMouseEvent", type="mouseReleased", x=x + dx, y=y + dy, **mouse)

    def close(self) -> None:
        self._browser.send("Target.closeTarget", targetId=self._target)


def picture(tab: Tab) -> NDArray:
    """(H, W, 3) in [0, 1] of what the page has drawn."""
    data = tab.evaluate("document.getElementById('view').toDataURL()").partition(",")[2]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), np.float64) / 255
