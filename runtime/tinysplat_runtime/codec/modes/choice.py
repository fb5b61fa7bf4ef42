"""Which mode a user gets of `auto`.

`auto` takes photos where every installation has the network, it is quick, and the file comes out smaller; else
gaussians.
"""

from __future__ import annotations

from ...container.photos import NetworkRef, Photos
from ...container.planes import Planes
from ...graphs.artifacts import load_manifest

AUTO_SECONDS = 2.0
"""`auto` takes photos only if the network runs within this time here: what decoding would take on a like machine."""


def choose(planes: bytes, photos: bytes, network: NetworkRef, network_seconds: float) -> tuple[str, str]:
    """What `auto` takes, `gaussians` or `photos`, and why."""
    ships = any(a.role == "network" and a.sha256 == network.sha256 for a in load_manifest().values())
    sizes = f"{len(photos)} bytes of photos, {len(planes)} of Gaussians"
    if not ships:
        return Planes.mode, f"receivers may lack network '{network.name}' ({sizes})"
    if network_seconds > AUTO_SECONDS:
        return Planes.mode, f"the network takes {network_seconds:.1f} s, over {AUTO_SECONDS:g} ({sizes})"
    if len(photos) >= len(planes):
        return Planes.mode, f"the smaller file ({sizes})"
    return Photos.mode, f"{sizes}; every installation has '{network.name}', which took {network_seconds:.1f} s here"
