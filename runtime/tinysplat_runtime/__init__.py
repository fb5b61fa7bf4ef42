"""TinySplat's runtime: posed photos to a tiny 3D Gaussian scene and back, with numpy, onnxruntime and av alone.

    scene = ts.load_scene("desk/")
    gaussians = ts.predict(scene.views([0, 4]))
    data = ts.compress(gaussians)
    image = ts.render(ts.decompress(data), scene.cameras[2])

Names are loaded on first use, so that importing the package opens no model, no file and no library.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.9.0"

_MODULE_OF = {
    "Camera": "scene.cameras",
    "FormatError": "errors",
    "Gaussians": "gaussian.gaussians",
    "InputError": "errors",
    "InputWarning": "errors",
    "Limits": "container.limits",
    "ModelError": "errors",
    "Notes": "gaussian.notes",
    "NumericError": "errors",
    "Runtime": "api",
    "Scene": "scene.scenes",
    "SceneWarning": "errors",
    "TinySplatError": "errors",
    "Told": "system.told",
    "Voice": "system.voice",
    "compress": "api",
    "convert": "api",
    "decompress": "api",
    "encode": "api",
    "inspect": "api",
    "load_gaussians": "api",
    "load_scene": "scene.intake.layouts",
    "predict": "api",
    "render": "api",
    "save_gaussians": "api",
}

__all__ = [
    "Camera",
    "FormatError",
    "Gaussians",
    "InputError",
    "InputWarning",
    "Limits",
    "ModelError",
    "Notes",
    "NumericError",
    "Runtime",
    "Scene",
    "SceneWarning",
    "TinySplatError",
    "Told",
    "Voice",
    "compress",
    "convert",
    "decompress",
    "encode",
    "inspect",
    "load_gaussians",
    "load_scene",
    "predict",
    "render",
    "save_gaussians",
]

if TYPE_CHECKING:
    from .api import (
        Runtime,
        compress,
        convert,
        decompress,
        encode,
        inspect,
        load_gaussians,
        predict,
        render,
        save_gaussians,
    )
    from .container.limits import Limits
    from .errors import FormatError, InputError, InputWarning, ModelError, NumericError, SceneWarning, TinySplatError
    from .gaussian.gaussians import Gaussians
    from .gaussian.notes import Notes
    from .scene.cameras import Camera
    from .scene.intake.layouts import load_scene
    from .scene.scenes import Scene
    from .system.told import Told
    from .system.voice import Voice


class _Door(ModuleType):
    """The package as a module whose public names stay what they are.

    Importing the subpackage `render` would otherwise put it in place of the function of that name.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Door


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
