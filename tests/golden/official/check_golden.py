"""Read a golden fixture and compare it with computed arrays, which are of full size under the same keys ("out/depth",
"mid/cnn_features", …); every array of a fixture was stored with a stride per axis.
"""

import json

import numpy as np


def load_fixture(path):
    """Returns (inputs, expected, meta): plain dicts of arrays, and the metadata."""
    with np.load(path, allow_pickle=False) as z:
        meta = json.loads(str(z["meta"]))
        inputs = {k[3:]: z[k] for k in z.files if k.startswith("in/")}
        expected = {k: z[k] for k in z.files if k.startswith(("out/", "mid/"))}
    return inputs, expected, meta


def subsample(array, stride):
    return array[tuple(slice(None, None, s) for s in stride)]


def nearest_sign(q, reference):
    """q and -q are the same rotation: take the one on the reference's side."""
    return np.where((q * reference).sum(-1, keepdims=True) < 0, -q, q)


def compare(expected, meta, actual, factor=1.0):
    """actual: dict key -> full-size array. Returns a list of result rows.

    Passes when |actual - expected| <= factor * (atol + rtol * |expected|) everywhere,
    with atol taken from the fixture (ten times the rounding error measured between a
    single- and a double-precision run of the reference) and rtol = 2e-4.
    """
    rows = []
    for key, want in expected.items():
        info = meta["tensors"][key]
        if key not in actual:
            rows.append((key, "missing", float("nan"), float("nan"), info["atol"]))
            continue
        got = np.asarray(actual[key])
        if list(got.shape) != info["full_shape"]:
            rows.append((key, f"shape {got.shape} != {info['full_shape']}", float("nan"), float("nan"), info["atol"]))
            continue
        got = subsample(got, info["stride"]).astype(np.float64)
        ref = want.astype(np.float64)
        if "rotations" in key:
            got = nearest_sign(got, ref)
        diff = np.abs(got - ref)
        ok = bool((diff <= factor * (info["atol"] + 2e-4 * np.abs(ref))).all())
        rows.append((key, "ok" if ok else "FAIL", float(diff.max()), float(diff.mean()), info["atol"]))
    return rows
