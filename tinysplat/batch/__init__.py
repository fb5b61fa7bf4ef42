"""Many scenes to many files: jobs and their results (`jobs`), the run itself (`run`), and where it may run (`cluster`).

Nothing here schedules: processes come from `concurrent.futures` (`tinysplat.workers`), clusters from Ray.
"""
