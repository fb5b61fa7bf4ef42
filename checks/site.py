"""The documentation site in a headless Chromium, opened from disk and without a network.

    make docs && apt-get install -y chromium && pip install playwright
    python checks/site.py [site] [screenshot.png]

Opens every page; fails on any request that leaves the disk or finds nothing, on any console message, and where the
search does not find a word that the pages hold.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

WORD, PAGE = "attribution", "FORMAT"


def search(page: Page) -> list[str]:
    """Addresses that the search finds for WORD."""
    page.locator(".md-search__input").fill(WORD)
    page.wait_for_selector(".md-search-result__link", timeout=30_000)
    return [str(link.get_attribute("href")) for link in page.locator(".md-search-result__link").all()]


def main(site: str = "site", screenshot: str | None = None) -> int:
    """Run the check; returns the exit status."""
    # 404.html is for servers: its addresses begin at the server's root.
    pages = sorted(p for p in Path(site).resolve().rglob("*.html") if p.name != "404.html")
    requests: set[str] = set()
    failed: set[str] = set()
    messages: set[str] = set()
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.set_offline(True)
        page = context.new_page()
        page.on("request", lambda request: requests.add(request.url))
        page.on("requestfailed", lambda request: failed.add(request.url))
        page.on("console", lambda message: messages.add(message.text))
        page.on("pageerror", lambda error: messages.add(str(error)))
        for path in pages:
            page.goto(path.as_uri())
            page.wait_for_load_state("networkidle")
        page.goto((Path(site).resolve() / "index.html").as_uri())
        addresses = search(page)
        if screenshot:
            page.screenshot(path=screenshot)
        browser.close()
    outside = sorted(url for url in requests if not url.startswith(("file:", "data:", "blob:")))
    is_found = any(f"{PAGE}.html" in address for address in addresses)
    print(f"{len(pages)} pages, {len(requests)} files; search for '{WORD}': {len(addresses)} results")
    for title, lines in (("outside", outside), ("failed", sorted(failed)), ("console", sorted(messages))):
        for line in lines:
            print(f"{title}: {line}")
    return 0 if pages and is_found and not (outside or failed or messages) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
