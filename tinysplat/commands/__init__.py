"""Commands that need more than the runtime; they join `tinysplat` through the entry-point group `tinysplat.commands`.

Each module has `HELP`, `configure(parser)` and `run(args)`; `tinysplat_runtime.cli` turns errors into exit statuses.
"""
