"""Many scenes to many files: jobs and their results (`jobs`), where they run (`engines`), and the run itself (`run`).

Nothing here schedules: processes come from `concurrent.futures`, clusters from Ray (extra `cluster`).
"""
