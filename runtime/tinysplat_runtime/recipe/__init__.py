"""The task, photos to a file: what is asked for as values, and what comes of it. The command line, `batch` and the
functions of `api` fill in the same request and hand it to the same function.

    request.py     every option of `encode`, `compress`, `decode` and `convert`: its kind, default and help
    options.py     what an option is
    words.py       kinds of options, in words and as values: `0,4`, `auto:3`, `384x256`, `100KB`, `10s`
    prepare.py     which photos, how large, between what depths
    memory.py      whether they fit
    choice.py      what they are made into, where nobody said
    ahead.py       the steps to come, and the share of time of each
    doubts/        what is likely wrong with them, a module per kind of evidence
    strangers.py   photos that the others contradict, which are left out
    stages.py      training and coding: a step each
    encode.py      all of it, in order, and the same of Gaussians that are at hand
    export.py      Gaussians on their way out: what `decode` and `convert` do
    own.py         how like its own photos the result looks
    report.py      what there is to say of it

Importing `request` and `words` loads no library, so that a command line is parsed at once.
"""
