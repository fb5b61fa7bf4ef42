"""Words of a command line as values, names of outputs, and what options are where none are given."""

from __future__ import annotations

import pytest

from tinysplat_runtime.cli.parser import build_parser


@pytest.mark.parametrize(
    ("line", "fields"),
    [
        ("view --networks --player -o d", {"networks": "node_modules/onnxruntime-web", "player": True}),
        ("view f --no-browser --port 80", {"no_browser": True, "port": 80}),
        ("render f -o o.png --depth --size 8x6 -q", {"depth": True, "size": (6, 8), "quiet": True}),
        ("render f -o o.png --depth-values --depth-scale 10", {"depth_values": True, "depth_scale": 10}),
        ("decode f -o g --dilate", {"dilate": 0.16}),
        ("decode f -o g --sh-bits 8,8 --spz-version 4 --fuse 2", {"sh_bits": (8, 8), "spz_version": 4, "fuse": 2}),
        (
            "decode f -o g --points --keep-all --gltf-spz --partial --force",
            {"points": True, "keep_all": True, "gltf_spz": True, "partial": True, "force": True},
        ),
        ("convert a -o b --crop 1,2,3,4,5,6 --check", {"crop": (1, 2, 3, 4, 5, 6), "check": True}),
        ("info f --json --max-memory 2GB --max-pixels 9", {"json": True, "max_memory": 2 * 10**9, "max_pixels": 9}),
    ],
)
def test_options_that_are_given_are_what_they_say(line: str, fields: dict[str, object]) -> None:
    parser, _ = build_parser()
    args = vars(parser.parse_args(line.split()))
    assert {name: tuple(args[name]) if isinstance(args[name], list) else args[name] for name in fields} == fields
