"""Trained agents: what they reach on plants that no training has seen, and where they fall behind.

    python -m studies.agents --stage all

The stages are `train`, `score`, `gap` and `curves`; each goes on where it was interrupted, and `all`
does one after the other. A training lies in a folder of its own under --runs; the tables are made of
the policies that are there.

By name alone: `ship` copies of each agent the policy of the training with the median score to those
of the release, `walk` runs the commands of `docs/train-an-agent.md` and keeps what they print, and
`page` makes that page and `docs/agents.md` from the tables. Edit their templates, never the pages.
"""
