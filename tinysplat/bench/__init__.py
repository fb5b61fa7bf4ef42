"""Error against run time: what every stage of the chain costs in seconds, bytes, memory and dB.

    timing      variants in interleaved rounds          machine     what a run was made on
    inputs      scenes and Gaussians to measure on      judge       what pictures lose
    sections    which stages, quick and full            run         one run, report, comparison with another
    views       how stages are shown                    report      the folder

A new stage is a function that returns `timing.Stage`, an entry in `sections.SECTIONS` and one in `views.VIEWS`.
"""
