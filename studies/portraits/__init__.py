"""Whether the portrait of an effect that no catalogue has is like it: `python -m studies.portraits`.

Plants with an effect of one of fourteen sorts that the catalogue does not have are measured with one
of two protocols. What is drawn of them is asked four things: the place in the chain, whether there is
a memory, the parity, and the time constant within a factor of two. `unknown` is then added to the
bare model, and both are tracked with. The truth is computed on a fine grid by code of its own: plays
from turning points, lags from the matrix exponential, nothing from the block. The search is left out:
the portrait begins with the bare model, refitted. An interrupted run continues.
"""
