"""The payoff: how far the tracking error falls once the belief knows the hidden effect.

    python -m benchmarks.payoff --out studies/results/payoff

Plants with hidden effects are measured and discovered as a user would, and then tracked by
compensators whose belief knows nothing of the effect, what was discovered, or the truth.
"""
