"""How commands end: by signals wherever they were started, and on outputs of any encoding."""

import io
import signal
import subprocess
import sys
import warnings
import weakref
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from types import ModuleType

import pytest

from tinysplat_runtime.cli import main
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.options import add_options
from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.scene.lenses import load_pycolmap


class Point:
    """An entry point of another package."""

    def __init__(self, name: str, module: object) -> None:
        self.name, self.module = name, module

    def load(self) -> object:
        if isinstance(self.module, Exception):
            raise self.module
        return self.module


def module(run: Callable[..., object], needs: tuple[str, ...] = ()) -> ModuleType:
    """A command as another package has it, with an option."""
    made = ModuleType("command")
    made.HELP, made.run, made.NEEDS = "does", run, needs  # type: ignore[attr-defined]

    def configure(parser: ArgumentParser) -> None:
        add_options(parser, Quiet)
        parser.add_argument("--x", type=int, default=7)

    made.configure = configure  # type: ignore[attr-defined]
    return made


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., object]], None]:
    """Registers what the command `own` does."""
    return lambda run: monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [Point("own", module(run))])


@pytest.fixture
def handlers() -> Iterator[None]:
    """Handlers as they were, after the test."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(("interrupt", "ends"), [(signal.SIG_IGN, True), (signal.default_int_handler, False)])
def test_sigterm_ends_a_command_where_a_shell_has_interrupts_ignored(own, handlers, interrupt, ends) -> None:
    found = []
    own(lambda _: found.append(signal.getsignal(signal.SIGTERM)))
    signal.signal(signal.SIGINT, interrupt)
    assert main(["own", "-q"]) == 0
    assert (found == [signal.SIG_DFL]) is ends and found != [signal.SIG_IGN]


def test_an_interrupt_that_a_callback_would_lose_comes_again(own, capsys, handlers) -> None:
    """Python releases import locks in a callback, whose exceptions it prints and drops."""
    source = "def released(_):\n    signal.raise_signal(signal.SIGINT)\n    return 0\n"
    names = {"signal": signal}
    exec(compile(source, "<frozen importlib._bootstrap>", "exec"), names)

    class Lock:
        pass

    def interrupted(_: object) -> None:
        lock = Lock()
        reference = weakref.ref(lock, names["released"])
        del lock
        assert reference() is None
        while True:  # until the interrupt comes
            pass

    own(interrupted)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert main(["own", "-q"]) == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_what_an_output_cannot_encode_is_escaped(own, monkeypatch, encoding) -> None:
    def fails(_: object) -> None:
        print("σ² → 0.3")
        raise InputError("'Łódź', expected another name", where="city")

    out, err = io.BytesIO(), io.BytesIO()
    own(fails)
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(out, encoding, write_through=True))
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(err, encoding, write_through=True))
    assert main(["own", "-q"]) == 2
    assert b"0.3" in out.getvalue() and b"city: '\\u0141" in err.getvalue()


def test_pycolmap_takes_no_signals() -> None:
    """What it takes for its dump of stacks is as before once it has loaded; in a process of its own, which ends."""
    code = f"""
import signal
from {load_pycolmap.__module__} import load_pycolmap
signal.signal(signal.SIGTERM, lambda *_: print("ended", flush=True))
load_pycolmap()
signal.raise_signal(signal.SIGTERM)
signal.raise_signal(signal.SIGABRT)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("ended\n", "", -signal.SIGABRT)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("no", where="a"), "a: no"),
        (FileNotFoundError(2, "No such file", "there"), "there: No such file"),
        (OSError("odd"), "odd"),
        (PermissionError(13, "Permission denied"), "Permission denied"),
        (MemoryError(), "memory"),
    ],
)
def test_errors_are_a_line_and_status_2(own, capsys, error: Exception, line: str) -> None:
    def fails(_: object) -> None:
        raise error

    own(fails)
    assert main(["own", "-q"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("tinysplat: ") and line in err and err.count("\n") == 1


def test_a_fault_of_ours_is_raised(own) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    own(fails)
    with pytest.raises(ZeroDivisionError):
        main(["own", "-q"])


def test_who_reads_no_further_ends_a_command_in_peace() -> None:
    code = "import sys; from tinysplat_runtime.cli import main; sys.exit(main(['models', '--json']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout and process.stderr
        process.stdout.close()
        assert (process.stderr.read(), process.wait(60)) == (b"", 0)


def test_our_warnings_are_a_line_and_those_of_libraries_none(own, monkeypatch, capsys) -> None:
    def warns(_: object) -> None:
        warnings.warn("desk: photos of noise", InputWarning, stacklevel=1)
        warnings.warn("old", DeprecationWarning, stacklevel=1)

    own(warns)
    monkeypatch.setattr(sys, "warnoptions", [])
    assert main(["own", "-q"]) == 0
    said = capsys.readouterr().err
    assert "photos of noise" in said and said.count("\n") == 1 and "old" not in said


@pytest.fixture
def others(monkeypatch):
    """Commands of other packages: one that runs, one that cannot load, one that lacks a package."""
    ran: list[object] = []

    def run(args) -> None:
        ran.append(args.x)

    def needy(args) -> int:
        raise ModuleNotFoundError("no such", name="plotter")

    points = [
        Point("good", module(run)),
        Point("lame", ModuleNotFoundError("no torch", name="torch")),
        Point("bare", module(run, ("os", "no_such_package"))),
        Point("needy", module(needy)),
    ]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points)
    return ran


def test_commands_of_other_packages_run(others, capsys) -> None:
    assert main(["good", "--x", "3", "-q"]) == 0 and main(["good", "-q"]) == 0
    assert others == [3, 7]
    for words, named in (
        (["lame"], ("torch", "tinysplat[lame]")),
        (["bare"], ("no_such_package", "tinysplat[bare]")),
        (["needy", "-q"], ("plotter", "tinysplat[needy]")),
    ):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert all(name in said for name in (words[0], *named)) and said.count("\n") == 1
    for words in (["nosuch"], []):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert all(name in said for name in ("bare", "good", "info", "lame"))


def test_help_lists_commands_even_those_that_cannot_run(others, capsys) -> None:
    for words, named in (
        (["--help"], ("good", "does", "bare", "encode", "torch")),
        (["lame", "--help"], ("lame", "torch")),
    ):
        with pytest.raises(SystemExit) as leaving:
            main(words)
        out = capsys.readouterr().out
        assert leaving.value.code == 0 and all(name in out for name in named)
