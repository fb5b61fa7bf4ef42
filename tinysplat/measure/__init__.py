"""One house of measuring: what is measured (`subjects`), what came of it (`rows`), and why (`studies`).

    ground     rows, metrics, lpips, clock, curves, subjects/
    on it      pictures, show/
    on these   runner, quality, study
    on top     studies/, one question each; none imports another

Networks, rasteriser, reference, export and runtime never import this package, and it uses no private name of theirs
(`tests/project/test_import_rules.py`).
"""
