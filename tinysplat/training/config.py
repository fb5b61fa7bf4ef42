"""The small file that says how to train: TOML, every key with a default but the folder of photos."""

import sys
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from tinysplat.networks.edge import MIN_SIDE, STRIDE
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import JsonObject

from .losses import LossWeights

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Section = TypeVar("_Section")


@dataclass(frozen=True)
class DataSettings:
    """Where samples come from; relative folders are relative to the configuration file.

    Attributes:
        photos: folder of scene folders whose photos are targets and textures, or empty for procedural scenes alone.
        pictures: folder of further photos for textures, searched to the bottom, or empty for none.
        validation: folder of scene folders with eval_index.json, or empty for none.
        seed: of weights, textures and samples.
        side: of the square crops, pixels; a multiple of 16.
        large_side, large_share: another size, and the share of samples that have it.
        photo_share: share of samples that are real photos, the others are procedural.
        many_views_share: share of samples with three or four views instead of two.
        targets: target views of a sample.
        zooms: sizes that targets are drawn at, as multiples of the views' size; one that is named twice is drawn twice
            as often. A photo is never enlarged for it.
        textures: size of the texture bank.
        workers: threads that make samples.
    """

    photos: str = ""
    pictures: str = ""
    validation: str = ""
    seed: int = 0
    side: int = 160
    large_side: int = 256
    large_share: float = 0.1
    photo_share: float = 0.5
    many_views_share: float = 0.1
    targets: int = 1
    zooms: tuple[float, ...] = (0.5, 1.0, 1.0, 2.0, 2.0)
    textures: int = 700
    workers: int = 1


@dataclass(frozen=True)
class OptimiserSettings:
    """AdamW, its schedule, what it trains, and the average of the weights.

    The rate rises over `warmup` steps, stays, and falls to a fiftieth along half a cosine over the last `cooldown`.
    `steps` may be changed between a run and its continuation; the checkpoint holds no schedule.

    Attributes:
        rate: learning rate.
        batch: samples per step.
        steps: after which training ends.
        warmup, cooldown: steps.
        average: decay of the exponential moving average of the weights.
        heads_alone: train nothing but `Edge.fine`, `Edge.head` and `Edge.coarse`.
    """

    rate: float = 1e-3
    batch: int = 2
    steps: int = 5000
    warmup: int = 100
    cooldown: int = 2000
    average: float = 0.998
    heads_alone: bool = False


@dataclass(frozen=True)
class RunSettings:
    """How it runs.

    Attributes:
        device: cpu, cuda, or auto for cuda where there is one.
        threads: of torch on the CPU; 0 leaves torch's choice.
        log_steps: between lines of the log.
    """

    device: str = "auto"
    threads: int = 0
    log_steps: int = 50


@dataclass(frozen=True)
class Config:
    """A training run."""

    data: DataSettings = field(default_factory=DataSettings)
    loss: LossWeights = field(default_factory=LossWeights)
    optimiser: OptimiserSettings = field(default_factory=OptimiserSettings)
    run: RunSettings = field(default_factory=RunSettings)

    def as_dict(self) -> JsonObject:
        """Plain numbers and strings, for the checkpoint; of folders only their names."""
        content = asdict(self)
        for name in ("photos", "pictures", "validation"):
            content["data"][name] = Path(content["data"][name]).name
        return content


def load_config(path: Path, **given: str) -> Config:
    """Read a configuration.

    Args:
        path: of the file.
        given: `photos`, `pictures`, `validation` and `device` that take the place of the file's, folders as they are.

    Raises:
        InputError: names the key that is unknown or of the wrong type, or the line that is not TOML.
    """
    try:
        document = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"not TOML ({error})", where=str(path)) from None
    config = _section(Config, document, str(path))
    folder = path.parent
    device = given.pop("device", config.run.device)
    if not config.data.zooms or not all(0.25 <= zoom <= 4 for zoom in config.data.zooms):
        raise InputError(f"{config.data.zooms}, expected numbers from 0.25 to 4", where=f"{path}: data.zooms")
    for name in ("side", "large_side"):
        side = getattr(config.data, name)
        if side < MIN_SIDE or side % STRIDE:
            message = f"{side}, expected a multiple of {STRIDE} from {MIN_SIDE} on"
            raise InputError(message, where=f"{path}: data.{name}")
    data = asdict(config.data)
    for name in ("photos", "pictures", "validation"):
        if data[name]:
            data[name] = str(folder / data[name])
    return Config(DataSettings(**{**data, **given}), config.loss, config.optimiser, replace(config.run, device=device))


def _section(kind: type[_Section], values: JsonObject, where: str) -> _Section:
    """A settings class out of a TOML table, types checked against its defaults."""
    default = kind()
    known = {entry.name for entry in fields(default)}  # type: ignore[arg-type]
    found: JsonObject = {}
    for name, value in values.items():
        if name not in known:
            raise InputError(f"unknown key, expected one of {', '.join(sorted(known))}", where=f"{where}: {name}")
        expected = getattr(default, name)
        if is_dataclass(expected):
            if not isinstance(value, dict):
                raise InputError("expected a table", where=f"{where}: {name}")
            found[name] = _section(type(expected), value, f"{where}: {name}")
            continue
        found[name] = _value(value, expected, f"{where}: {name}")
    return kind(**found)


def _value(value: Any, expected: Any, where: str) -> Any:
    """A value of the type of its default, numbers taken for numbers, lists of them for tuples."""
    if isinstance(expected, tuple):
        if not isinstance(value, list):
            raise InputError(f"{value!r}, expected a list", where=where)
        return tuple(_value(part, expected[0], where) for part in value)
    accepted = (int, float) if isinstance(expected, float) else (type(expected),)
    if (isinstance(value, bool) and not isinstance(expected, bool)) or not isinstance(value, accepted):
        raise InputError(f"{value!r}, expected {type(expected).__name__}", where=where)
    return type(expected)(value)
