"""Manifests of strangers: SECURITY promises that they run no code and write in the batch's folder alone."""

import json
from pathlib import Path

import pytest
from console import tinysplat
from scenes import refusing, tells, write_scene

from tinysplat.batch.jobs import read_manifest
from tinysplat_runtime.errors import InputError


@pytest.mark.parametrize(("option", "value"), [("provider", "X:library={}"), ("model", "{}")])
def test_a_manifest_loads_no_code_or_graph_unless_the_command_line_allows_it(
    tmp_path: Path, option: str, value: str
) -> None:
    write_scene(tmp_path / "s", views=2, height=32, width=48)
    (tmp_path / "mine.so").write_bytes(b"\x7fELF and nothing")
    entry = {"scene": "s", option: value.format(tmp_path / "mine.so")}
    (tmp_path / "list.txt").write_text(json.dumps(entry))
    command = ("batch", tmp_path / "list.txt", "-o", tmp_path / "out", "--workers", 1)
    refused = tinysplat(*command)
    assert refused.returncode == 2 and tells(refused.stderr, f"1: --allow {option}")
    assert not (tmp_path / "out").exists()
    other = {"model": "provider", "provider": "model"}[option]
    assert f"--allow {option}" in tinysplat(*command, "--allow", other).stderr
    allowed = tinysplat(*command, "--allow", option)  # now it is loaded, and what it is comes out
    assert allowed.returncode == 2 and "--allow" not in allowed.stderr and (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name",
    ["../x", "a/b", r"..\..\x", "C:x", r"C:\x", "a:stream", "NUL", "com1.txt", "aux ", "x.", ".x", "a\x1b]0;b\x07",
     "\ud800", "n" * 201],
)  # fmt: skip
def test_an_output_is_named_alike_in_the_batchs_folder_on_every_system(name: str) -> None:
    with pytest.raises(InputError) as caught:
        read_manifest(json.dumps({"scene": "s", "name": name}), "out", {})
    assert caught.value.where == "line 1: name"


def test_names_that_one_file_would_hold_are_told_apart() -> None:
    with refusing(InputError, "2 'S' 1"):
        read_manifest("s\nS", "out", {})


@pytest.mark.parametrize(("scene", "name"), [("desk", "desk"), ("s3://b/room/", "room"), (r"D:\scans\hall", "hall")])
def test_a_scene_names_its_output(scene: str, name: str) -> None:
    (job,) = read_manifest(scene, "out", {})
    assert job.output == f"out/{name}.tsplat"


def test_names_of_people_are_plain() -> None:
    jobs = read_manifest(
        "\n".join(json.dumps({"scene": "s", "name": n}) for n in ("Küche 2", "部屋", "v1.2", "con_a")), "o", {}
    )
    assert [job.name for job in jobs] == ["Küche 2", "部屋", "v1.2", "con_a"]
