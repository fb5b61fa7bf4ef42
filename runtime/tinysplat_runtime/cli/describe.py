"""What a file holds, as `info` says it: .tsplat files, and all other Gaussian files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..system.jsonfields import JsonObject

MOST_LISTED = 12
"""Views whose bytes `info` lists one by one."""


def describe_gaussians(file: str) -> JsonObject:
    """Format, size, number, degree, extent and notes of a Gaussian file, ready for JSON.

    Raises:
        InputError: missing, damaged, or of an unknown ending.
    """
    from ..formats.table import find_format, load_gaussians

    if Path(file).is_dir():
        from ..formats.sog import in_folder

        file = str(in_folder(Path(file)))
    gaussians = load_gaussians(file)
    flat = gaussians.flat()
    means = flat.means.astype(np.float64) + flat.origin
    return {
        "file": file,
        "format": find_format(file, written=False).name,
        "bytes": Path(file).stat().st_size,
        "gaussians": gaussians.count,
        "sh_degree": gaussians.degree,
        "views": [[camera.width, camera.height] for camera in gaussians.cameras],
        "layers": len(gaussians.layers),
        "box": [means.min(axis=0).tolist(), means.max(axis=0).tolist()],
        "median_scale": float(np.median(flat.scales)),
        "median_opacity": float(np.median(flat.opacities)),
        "notes": gaussians.notes.given(),
    }


def gaussians_text(about: JsonObject) -> str:
    """The same as text."""
    low, high = (", ".join(f"{value:.4g}" for value in corner) for corner in about["box"])
    views = (
        f"{len(about['views'])} views of {about['views'][0][0]}x{about['views'][0][1]}"
        if about["views"]
        else "no views"
    )
    return "\n".join(
        [
            f"{about['file']}: {about['format']}, {about['bytes']} bytes",
            f"{about['gaussians']} Gaussians of SH degree {about['sh_degree']}, {views}",
            f"({low}) to ({high}); medians: scale {about['median_scale']:.4g}, opacity {about['median_opacity']:.3g}",
            *(f"{name}: {text}" for name, text in about["notes"].items()),
        ]
    )


def info_text(file: str, described: JsonObject) -> str:
    """`inspect`'s object as the text that `info` prints."""
    d = described
    total = d["bytes"]
    lines = [
        f"{file}: {total} bytes, format {d['version']}, mode {d['mode']}, profile {d['profile']}, Q_g {d['qp']:g}",
        _views_text(d),
        *_network_lines(d),
        *(f"{name}: {text}" for name, text in d["notes"].items() if text),
        *([f"refined: {d['refined']}"] if d["refined"] else []),
        *(["antialiased: yes"] if d["antialiased"] else []),
        *([f"Gaussians: {d['pruned']}"] if d["pruned"] else []),
        *([f"tiers: {' + '.join(f'{count:,}' for count in d['tiers'])}"] if len(d["tiers"]) > 1 else []),
        "",
        "class        bytes   share",
        *(f"{name:9} {n:8}  {n / total:6.1%}" for name, n in d["bytes_by_class"].items()),
        f"{'metadata':9} {d['metadata_bytes']:8}  {d['metadata_bytes'] / total:6.1%}",
        "",
        *_view_lines(d["bytes_by_view"]),
        "layer plane       coding    QP         step    bytes",
        *(_plane_text(plane) for plane in d["planes"]),
        "",
        "a prefix of  adds",
        *(f"{p['bytes']:11}  layer {p['layer']}: {', '.join(p['adds'])}" for p in d["prefixes"]),
    ]
    left_out = d["left_out"]
    if d["views"] > MOST_LISTED:  # that a plane is constant stands above
        left_out = [entry for entry in left_out if entry.get("why") != "constant"]
    if left_out:
        lines += ["", "left out", *(f"  {_left_out_text(entry)}" for entry in left_out)]
    return "\n".join(lines)


def _view_lines(sizes: Sequence[int]) -> list[str]:
    """Bytes by view; of many views, how they are spread."""
    if not sizes:
        return []
    if len(sizes) <= MOST_LISTED:
        return ["view         bytes", *(f"{view:<9} {n:8}" for view, n in enumerate(sizes)), ""]
    low, middle, high = min(sizes), sorted(sizes)[(len(sizes) - 1) // 2], max(sizes)
    spread = (("least", low), ("median", middle), ("most", high))
    return ["views        bytes", *(f"{word:<9} {n:8}  view {sizes.index(n)}" for word, n in spread), ""]


def _views_text(d: JsonObject) -> str:
    if not d["views"]:
        return f"a list of {d['gaussians']} Gaussians of SH degree {d['sh_degree']}, k = {d['k']}"
    views = f"{d['views']} views of {d['width']}x{d['height']}"
    if d["gaussians"] is None:
        return views
    return f"{views}, {d['gaussians']} Gaussians in {len(d['layers'])} layers, SH degree {d['sh_degree']}, k = {d['k']}"


def _network_lines(d: JsonObject) -> list[str]:
    if d["network"] is None:
        return []
    network, photos = d["network"], d["photos"]
    return [
        f"network {network['name']}, sha256 {network['sha256']}, near {network['near']:g}, far {network['far']:g}",
        f"photos of {photos['width']}x{photos['height']} at QP {photos['qp']}: {photos['bytes']} bytes",
    ]


def _plane_text(plane: JsonObject) -> str:
    if plane["coding"] == "constant":
        return f"{plane['layer']:5} {plane['name']:11} constant   –  = {plane['value']:<10.4g} {plane['bytes']:7}"
    coding = f"{plane['coding']:8} {plane['qp']:3} {plane['step']:12.4g}"
    return f"{plane['layer']:5} {plane['name']:11} {coding} {plane['bytes']:8}"


def _left_out_text(entry: JsonObject) -> str:
    facts = {key: value for key, value in entry.items() if key not in ("layer", "what", "why")}
    rest = [f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in facts.items()]
    return (
        f"layer {entry['layer']}: {entry['what']} ({', '.join([*([entry['why']] if 'why' in entry else []), *rest])})"
    )
