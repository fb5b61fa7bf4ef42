"""The task, photos to a file: what is asked for as values, and what comes of it. The command line, `batch` and the
functions of `api` fill in the same request and hand it to the same function.

    request.py     every option of `encode`, `compress`, `decode` and `convert`: its kind, default and help
    options.py     what an option is
    words.py       kinds of options, in words and as values: `0,4`, `auto:3`, `384x256`, `100KB`, `10s`
    encode.py      photos to a file: all steps, in order
    steps.py       what a step is, and what steps hand on
    prepare.py     which photos, how large, between what depths
    kinds.py       what they become: planes, one trained list, or a file of themselves
    memory.py      whether they fit
    forecast.py    what is likely to come of them
    doubts/        what is likely wrong with them, a module per kind of evidence
    strangers.py   photos that the others contradict, which are left out
    coding.py      Gaussians to bytes
    compress.py    Gaussians that are at hand to a file
    export.py      Gaussians on their way out: what `decode` and `convert` do
    own.py         how like its own photos the result looks
    report.py      what there is to say of it

Importing `request` and `words` loads no library, so that a command line is parsed at once.
"""
