"""What a release consists of, in dist/: wheel, sdist, bill of materials (CycloneDX), a recipe for conda-forge and
checksums (`make release`).

Everything is built twice from what git has committed, by two builds that share nothing, and refused unless both give
the same bytes: whoever has the commit can check that the files on the index are it.
"""

import gzip
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def git(*words: str) -> bytes:
    """What git prints."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True).stdout


def build(epoch: int) -> dict[str, bytes]:
    """Wheel and sdist by name, of a fresh copy of HEAD."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(git("archive", "HEAD"))) as archive:
            archive.extractall(folder, filter="data")
        command = [sys.executable, "-m", "build", "--outdir", f"{folder}/out", folder]
        environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch)}
        subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
        made = {path.name: path.read_bytes() for path in sorted(Path(folder, "out").iterdir())}
    return {name: settled(data, epoch) if name.endswith(".tar.gz") else data for name, data in made.items()}


def settled(sdist: bytes, epoch: int) -> bytes:
    """The archive without the times and owners of the machine that packed it, which setuptools leaves in."""
    packed = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(sdist)) as old,
        gzip.GzipFile("", "wb", fileobj=packed, mtime=epoch) as zipped,
        tarfile.open(fileobj=zipped, mode="w", format=tarfile.PAX_FORMAT) as new,
    ):
        for entry in sorted(old.getmembers(), key=lambda member: member.name):
            content = old.extractfile(entry) if entry.isfile() else None
            entry.mtime, entry.uid, entry.gid, entry.uname, entry.gname, entry.pax_headers = epoch, 0, 0, "", "", {}
            new.addfile(entry, content)
    return packed.getvalue()


def bill_of_materials(name: str, wheel: bytes) -> bytes:
    """CycloneDX of what `pip install` of the wheel brings, without what differs from one run to the next."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(f"{folder}/env", with_pip=True)
        python, file = f"{folder}/env/bin/python", Path(folder, name)
        file.write_bytes(wheel)
        subprocess.run([python, "-m", "pip", "install", "-q", str(file)], check=True)
        subprocess.run([python, "-m", "pip", "uninstall", "-q", "-y", "pip", "setuptools"], check=True)
        command = [sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible", "--of", "JSON", python]
        bill = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    for component in bill["components"]:  # where the wheel lay
        component.pop("externalReferences", None)
    return json.dumps(bill, indent=1, sort_keys=True).encode() + b"\n"


def recipe(sdist: str, data: bytes, wheel: bytes) -> bytes:
    """conda-forge's recipe.yaml: what the wheel declares, and where the sdist will lie."""
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        declared = message_from_bytes(archive.read(name))
    needed = [entry for entry in declared.get_all("Requires-Dist") if "extra ==" not in entry]
    return (
        (ROOT / ".ci" / "conda.yaml")
        .read_text("utf-8")
        .format(
            version=declared["Version"],
            sdist=sdist,
            sha256=hashlib.sha256(data).hexdigest(),
            run="\n".join(f"    - {re.sub('(?=[<>=!])', ' ', entry, count=1)}" for entry in needed),
            source=next(url.split(", ")[1] for url in declared.get_all("Project-URL") if url.startswith("Source")),
            description=json.dumps(declared["Summary"]),
        )
        .encode()
    )


def main() -> int:
    """Write dist/, or say what differs."""
    if git("status", "--porcelain", "--untracked-files=no").strip():
        print("files differ from HEAD: commit them first", file=sys.stderr)
        return 1
    epoch = int(git("log", "-1", "--format=%ct"))
    files, again = build(epoch), build(epoch)
    if different := [name for name in files if files[name] != again.get(name)]:
        print(f"two builds differ: {', '.join(different)}", file=sys.stderr)
        return 1
    wheel = next(name for name in files if name.endswith(".whl"))
    sdist = next(name for name in files if name.endswith(".tar.gz"))
    files["recipe.yaml"] = recipe(sdist, files[sdist], files[wheel])
    files["tinysplat.cdx.json"] = bill_of_materials(wheel, files[wheel])
    out = ROOT / "dist"
    out.mkdir(exist_ok=True)
    for name, data in files.items():
        (out / name).write_bytes(data)
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items()))
    (out / "SHA256SUMS").write_text(sums)
    print(sums, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
