"""Third study of the search: plants in forms, protocols and faults of neither other study.

    python -m studies.third_effects --check      # draw and validate all cases, without a search
    python -m studies.third_effects --jobs 2     # search all of them; an interrupted run continues

A guard: its records were drawn, and their sums stored, before the search that it judges had seen
any of them. It is run on all cases or on none, and looked at once; another look is at another seed.
"""
