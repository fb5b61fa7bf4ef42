"""Execution providers of onnxruntime: those it was built with, and those that plug-ins bring while it runs.

A plug-in is a library that onnxruntime loads by `register_execution_provider_library`. Packages that bring one are
called `onnxruntime_ep_…` and answer `get_library_path()` and `get_ep_names()`; any other is named by its path.
"""

import importlib
import json
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from ..errors import InputError, ModelError

Provider = str | tuple[str, Mapping[str, str]]
"""A provider's name, or its name and options, as `onnxruntime.InferenceSession` takes them; of options `library` is the
path of a plug-in, and `device_type` (CPU, GPU or NPU) chooses among a plug-in's devices."""

CPU = "CPUExecutionProvider"

_SUFFIX, _PACKAGES = "ExecutionProvider", "onnxruntime_ep_"
_REGISTERING = threading.Lock()


def parse_provider(text: str) -> tuple[str, dict[str, str]]:
    """Name and options of `NAME[:key=value[,key=value]]`.

    Raises:
        InputError: there is no name, or an option without a key or a value.
    """
    name, colon, rest = text.partition(":")
    options: dict[str, str] = {}
    for item in rest.split(",") if colon else ():
        key, _, value = (part.strip() for part in item.partition("="))
        if not key or not value:
            raise InputError(f"'{item}' in '{text}', expected NAME:key=value[,key=value]", where="provider")
        options[key] = value
    if not name:
        raise InputError(f"'{text}' names none, expected NAME[:key=value[,key=value]]", where="provider")
    return name, options


def providers_of(text: str | None) -> tuple[Provider, ...]:
    """What `--provider` names, and the CPU behind it; errors of `parse_provider`."""
    return (parse_provider(text), CPU) if text else (CPU,)


def known_providers(library: ModuleType) -> list[str]:
    """Names of what this onnxruntime has, and of what installed plug-in packages bring; loads no plug-in."""
    return list(dict.fromkeys([*library.get_available_providers(), *_plugins()]))


def add_providers(
    library: ModuleType, options: Any, providers: Sequence[Provider]
) -> list[tuple[str, dict[str, str]]] | None:
    """Bring providers into a session's options.

    Args:
        library: onnxruntime.
        options: its SessionOptions, which take plug-ins' devices.
        providers: in order of preference; names without `ExecutionProvider` do as well.

    Returns:
        What to give InferenceSession as `providers`; None where a plug-in is among them, and `options` have all.

    Raises:
        ModelError: a provider is not there, or its plug-in cannot be loaded or has no device here.
    """
    chosen: dict[str, tuple[dict[str, str], list[Any]]] = {}
    for provider in providers:
        name, given = (provider, {}) if isinstance(provider, str) else provider
        full, own, devices = _find(library, name, given)
        chosen.setdefault(full, (own, devices))
    if not any(devices for _, devices in chosen.values()):
        return [(name, own) for name, (own, _) in chosen.items()]
    try:
        for name, (own, devices) in chosen.items():
            if devices:
                options.add_provider_for_devices(devices, own)
            else:
                options.add_provider(name, own)
    except Exception as error:  # onnxruntime raises a dozen unrelated types
        raise ModelError(f"{name}: {first_line(error)}", where="provider") from error
    return None


def _find(library: ModuleType, name: str, given: Mapping[str, str]) -> tuple[str, dict[str, str], list[Any]]:
    """Full name, options, and of a plug-in the device to run on."""
    own = dict(given)
    path = own.pop("library", None)
    full = name if name.endswith(_SUFFIX) else name + _SUFFIX
    if path is None and full in library.get_available_providers():
        return full, own, []
    with _REGISTERING:
        if not _devices(library, name, full):
            _register(library, name, full, path)
    devices = _devices(library, name, full)
    if not devices:
        here = ", ".join(sorted({f"{d.device.vendor} {d.device.type.name}" for d in library.get_ep_devices()}))
        raise ModelError(f"{full} is there and takes no device of this machine ({here})", where="provider")
    kinds = {device.device.type.name: device for device in reversed(devices)}  # of a kind the first
    wanted = own.pop("device_type", devices[0].device.type.name)
    if wanted not in kinds:
        raise ModelError(f"{full} has no {wanted}, its device_type here is {' or '.join(kinds)}", where="provider")
    return kinds[wanted].ep_name, own, [kinds[wanted]]


def _devices(library: ModuleType, *names: str) -> list[Any]:
    return [device for device in library.get_ep_devices() if device.ep_name in names]


def _register(library: ModuleType, name: str, full: str, path: str | None) -> None:
    """Load a plug-in under the name that was asked for, by which some call themselves."""
    plugins = _plugins()
    package = plugins.get(name) or plugins.get(full)
    if path is None and package is None:
        have = ", ".join(known_providers(library))
        raise ModelError(f"execution provider {full} is not in this onnxruntime; it has {have}", where="provider")
    try:
        plugin = str(Path(path).resolve()) if path else package.get_library_path()  # type: ignore[union-attr]
        library.register_execution_provider_library(name, plugin)
    except Exception as error:
        raise ModelError(f"{full}: {first_line(error)}", where="provider") from error


def _plugins() -> dict[str, Any]:
    """Installed plug-in packages by the providers that they bring."""
    import pkgutil

    packages: dict[str, Any] = {}
    for module in pkgutil.iter_modules():
        if module.name.startswith(_PACKAGES):
            try:
                package = importlib.import_module(module.name)
                packages.update(dict.fromkeys(package.get_ep_names(), package))
            except Exception:  # a package of that name that is no plug-in, or is broken: it brings nothing
                continue
    return packages


def nodes_by_provider(profile: str) -> dict[str, int]:
    """Providers and how often each ran a node, by a file that a session's `end_profiling` names."""
    events = json.loads(Path(profile).read_text("utf-8"))
    ran = (event.get("args", {}).get("provider") for event in events if event.get("cat") == "Node")
    return dict(Counter(name for name in ran if name))


def first_line(error: Exception) -> str:
    """What an error of onnxruntime says first, at most 300 characters."""
    return str(error).strip().split("\n")[0][:300]
