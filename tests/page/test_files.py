"""Bytes on their way into the page, and what it says of them."""

from __future__ import annotations

from typing import Any

from page.scripts import run as run_with

START = 'import { bytesByUse, fetched, inKilobytes, paced } from "./files.js";\n'


def run(code: str, **given: Any) -> Any:
    return run_with(code, START, **given)


def test_sizes_are_said_in_few_digits() -> None:
    sizes = {0: "0.1 KB", 99: "0.1 KB", 149: "0.1 KB", 151: "0.2 KB", 9949: "9.9 KB", 10000: "10 KB", 999499: "999 KB",
             1000000: "1.0 MB", 2345678: "2.3 MB"}  # fmt: skip
    assert run("return sizes.map(inKilobytes)", sizes=list(sizes)) == list(sizes.values())


def test_bytes_are_counted_by_what_they_are_for() -> None:
    about = {
        "bytes": 1000,
        "sections": [{"name": "PHOT[0]", "bytes": 40}, {"name": "PHOT[1]", "bytes": 2}, {"name": "LAYR[0]",
          "bytes": 50}],
        "channels": [
            [{"name": "depth0", "bytes": [100, 20]}, {"name": "color12", "bytes": [300]}, {"name": "opacity0",
              "bytes": []}],
            [{"name": "color0", "bytes": [5]}, {"name": "odd1", "bytes": [7]}, {"name": "scale1", "bytes": [11]},
             {"name": "rotation0", "bytes": [13]}, {"name": "offset1", "bytes": [17]}],
        ],
    }  # fmt: skip
    found = run("return [bytesByUse(about), bytesByUse({ ...about, sections: [], bytes: 473 })]", about=about)
    uses = [
        ["distances", 120],
        ["colours", 305],
        ["odd1", 7],
        ["sizes", 11],
        ["directions", 13],
        ["fine positions", 17],
    ]
    assert found == [[*uses, ["photos", 42], ["description", 485]], uses]


def test_bytes_at_hand_come_in_two_when_there_is_something_to_see_before() -> None:
    assert run(
        """
        const bytes = Uint8Array.from({ length: 9 }, (_, i) => i), answers = [];
        for (const steps of [[3, 5, 9], [9], [], [4]]) {
          const chunks = [];
          let waits = 0;
          for await (const chunk of paced(bytes, steps, async () => { waits++; })) chunks.push(chunk.length, chunk[0]);
          answers.push([chunks, waits]);
        }
        return answers;
        """
    ) == [[[3, 0, 6, 3], 2], [[9, 0], 1], [[9, 0], 1], [[4, 0, 5, 4], 2]]


def test_addresses_are_read_as_they_come_in_and_up_to_a_limit() -> None:
    found = run(
        """
        const asked = [], answers = [];
        let sizes = [3, 4], headers = { "Content-Length": "7" }, ok = true;
        Object.assign(globalThis, { location: { href: "https://example.org/a/page.html" }, fetch: async (url,
          options) => {
          asked.push([url.href, options]);
          const left = [...sizes];
          return { ok, status: 404, statusText: "Not Found", headers: new Map(Object.entries(headers)), body: {
            getReader: () => ({
            read: async () => (left.length ? { value: { length: left.shift() }, done: false } : { done: true }) }) } };
        } });
        const read = async (address) => {
          const told = [], got = [];
          try {
            for await (const chunk of fetched(address, "stop", (...given) => told.push(given))) got.push(chunk.length);
            answers.push([told, got]);
          } catch (error) {
            answers.push([told, error.message]);
          }
        };
        await read("b.tsplat");
        [sizes, headers] = [[2 ** 30], {}];
        await read("data:,x");
        sizes = [2 ** 30, 1];
        await read("http://example.org/c");
        await read("file:///etc/passwd");
        ok = false;
        await read("blob:abc");
        return [answers, asked.slice(0, 2)];
        """
    )
    whole = 1 << 30
    assert found[0] == [
        [[[3, 7], [7, 7]], [3, 4]], [[[whole, 0]], [whole]], [[[whole, 0]], f"more than {whole} bytes"],
        [[], "file: is no address that a page may read; choose the file instead"], [[],
          "blob:abc answers 404 Not Found"],
    ]  # fmt: skip
    options = {"signal": "stop", "credentials": "omit", "referrerPolicy": "no-referrer"}
    assert found[1] == [["https://example.org/a/b.tsplat", options], ["data:,x", options]]
