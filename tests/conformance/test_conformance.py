"""Both decoders against the corpus."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conformance.reference import arrays_of, decode
from conformance.run import CASES, Answer, described, fault, names
from web.node import SCRIPT, Decoder, node

import tinysplat_runtime as ts

LACKING: dict[str, set[str]] = {"python": set(), "javascript": {"network"}}
"""What a decoder cannot do by itself."""


def cases_for(decoder: str) -> list[str]:
    """The cases that a decoder is held to."""
    return [name for name in names() if not LACKING[decoder] & set(described(name)[1].get("needs", []))]


@pytest.mark.parametrize("name", cases_for("python"))
def test_the_runtime(name: str) -> None:
    def answer(path: Path, options: dict[str, Any]) -> Answer:
        try:
            return arrays_of(decode(path.read_bytes(), **options))
        except ts.FormatError:
            return None

    assert fault(name, answer) is None


@pytest.fixture(scope="module")
def javascript() -> Any:
    """tsplat.js in node."""
    with Decoder() as running:
        yield running


@pytest.mark.parametrize("name", cases_for("javascript"))
def test_tsplat_js(javascript: Decoder, name: str) -> None:
    def answer(path: Path, options: dict[str, Any]) -> Answer:
        said, arrays = javascript(path.read_bytes(), **options)
        assert said.get("error", "TsplatError") == "TsplatError"
        return arrays or None

    assert fault(name, answer) is None


def test_the_runner_tells_a_decoder_that_fails(tmp_path: Path) -> None:
    runner = [sys.executable, str(CASES.parent / "run.py"), "--cases", "paper_degree0,refused_magic", "--"]
    good = subprocess.run([*runner, node(), str(SCRIPT)], capture_output=True, text=True, check=False)
    assert good.returncode == 0
    script = tmp_path / "wrong.py"
    script.write_text(
        "import sys, numpy as np\n"
        f"with np.load({str(CASES / 'paper_degree0' / 'expected.npz')!r}) as a: d = dict(a)\n"
        "d['quats'] = d['quats'] + 1e-4\nnp.savez(sys.argv[2], **d)\n"
    )
    wrong = subprocess.run([*runner, sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert all(word in wrong.stdout for word in ("paper_degree0", "quats", "refused_magic"))


def test_the_corpus_has_every_mode() -> None:
    modes = {ts.inspect(described(name)[0].read_bytes())["mode"] for name in cases_for("python") if plain(name)}
    assert modes == {"gaussians", "list", "lossless", "photos"}


def plain(name: str) -> bool:
    """Whether a case is a whole file that is read."""
    case = described(name)[1]
    return "refused" not in case and "recover" not in case.get("options", {})
