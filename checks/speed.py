"""Seconds of tsplat.js in a headless Chromium, on a file's own bytes, decoded again and again.

    apt-get install -y chromium
    python checks/speed.py F.tsplat [TIMES]

Prints the least and the median of decodes with two workers, with none, and the first one, which compiles.
"""

from __future__ import annotations

import functools
import http.server
import sys
import tempfile
import threading
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "runtime")]

from page.browser import Browser  # noqa: E402
from web.test_browser import PAGE, Handler  # noqa: E402

RUN = """(async () => {
  const times = [];
  for (let i = 0; i < TIMES; i++) {
    const began = performance.now();
    await tsplat.decode(bytes, { threads: THREADS });
    times.push(performance.now() - began);
    await new Promise((done) => setTimeout(done, 20));
  }
  return times;
})()"""


def main(file: str, times: str = "40") -> int:
    """Run the check; returns the exit status."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "index.html").write_text(PAGE)
        (Path(name) / "scene.tsplat").write_bytes(Path(file).read_bytes())
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=name))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with Browser() as browser:
            for threads in (2, 0):
                tab = browser.open(f"http://127.0.0.1:{server.server_port}/index.html", 64, 64)
                tab.wait("window.isReady")
                milliseconds = tab.evaluate(RUN.replace("TIMES", times).replace("THREADS", str(threads)))
                least, median = min(milliseconds), sorted(milliseconds)[len(milliseconds) // 2]
                print(
                    f"{threads} workers: first {milliseconds[0]:.0f} ms, least {least:.1f}, median {median:.1f}",
                    flush=True,
                )
                tab.close()
        server.shutdown()
        server.server_close()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
