"""Diagnosis by one law: one score, one decision, a beam of sets, probabilities from the same draws.

1. A model is a kind of core, a set of effects in their forms, and clock faults of records. A move adds,
   drops or exchanges one of these, or adds two effects at once (``moves``).
2. The score of a set is the logarithm of the mean square of what it leaves of a block over that of its
   record's floor, zero at the floor and below; the floor is what the noise is at most, known from so many
   samples, with what the simulation leaves open between samples and between thresholds; blocks are as long as the residual is correlated, and no set is
   fitted to what it is scored on: stretches of the records to fit are left out in turn by one
   Gauss-Newton step, the records to judge by are never fitted (``score``). Numbers that tell of the
   experiment and not of the plant, as offsets and all that goes by the clock do, go on into the records
   to judge by: they are refitted to all records, and each stretch is predicted from the others. A record whose opening spoils the
   fit of the rest by more than its phantom does, as many samples at the end, and beside any initial
   memory, counts where its memory is known but for an offset: in stretches in which the command stays
   within the range that it has passed, each with its own offset (``openings``).
3. A move is better where its set outweighs the one that it is of, in the mean over the bootstrap: by
   the gain over the blocks, the prior, and less what its phantoms gain, the same effect or clock fault
   driven by the command in reverse or of another record, less what its own columns explain
   (``decision``, ``models``). A chance would ask for a gain in many blocks: what shows in one is not drawn
   in a third of the draws, however large it is. First looks, of which no prior speaks, race by chance.
4. Best first: the set that weighs most goes on next, by every move, and after it those of the best few
   that have a weight or are behind the best one by no more than it leaves. Which start of a form promises
   most beside a set is linear algebra on columns that were simulated once (``signatures``), those of a law
   of the rate beside the set itself. What promises most is followed for a few steps, and of these looks the
   best are refitted, and whatever promised most (``moves``, ``expansion``). In the set that leads, each
   name is exchanged against the others, too. A set goes on while one effect more, were nothing left then,
   could make it weigh more than the best one, and not after several that each took less than was left.
5. A set's weight is that of pseudo-BMA+ under the same draws. The best set is held against those with one
   name less, the others then in richer forms too, a richer form, or a stage under another name until none
   of them weighs more, and goes on where it then may. The probability of a set is its weight by all
   values of a residual in five of nine draws, so that what is found by these alone is likely, and in the
   others by the share of them that is independent in what the best set leaves, by record, 1 where that is
   white; that of a name is of the sets that have it. A name is *found* from 90 % on and *likely* from 50,
   of it or a name that takes its weight; a name that a free block in its place beats in the bootstrap, or
   that takes less of the score than its set leaves above the floor, is a *stand-in* (``grades``): whatever
   leaves that may be its cause too.

Every number that does not come from the data stands in ``constants.TABLE``.

Limits
------
- Names and times, paired with the search before: ``studies/results/one_law``.
- What goes by the clock beside other effects is followed by smooth curves of fourteen knots; a walk
  that is rougher leaves a few per cent above the floor, and further names are asked of it.
- Time: longest where much is left that nothing takes, as each refitted set offers as many again. Long
  records: ``python -m studies.one_law --part long``.
- A backlash with a compliant contact is no form: from seven starts between 0.002 and 0.2 of the stroke,
  looks and refits of the catalogue's end at the same 1.56 floors, as the plays take nearly all of it.
- Preprocessing's findings forbid no name: a record that leads by a sample is moved alone, not those that
  share its clock.
- Kinds of core with many gains are tried once, at the end, beside the best set and alone.
- The temperature was fitted to sets that a search at 2 had visited. Eleven, of less log loss, ends a
  search too early (PICMA at 0.213 µm). An initial memory stays in the place of a backlash at 1.6 floors on
  one plant that was named right before: few blocks hold what is left.
  Halving and doubling each constant, on ten plants that are named right: ``studies/results/constants``.
- Jitter of a clock is no move, and no clock that loses a whole sample at a time.
- Checks without a model do not forbid a name yet. The opening of a record that is only to be judged by
  counts where no other one spoils the fit (a hum beside a backlash, seed 31: 10.4 floors with it, 1.0
  without, the same name found); a search that left openings out is not resumed from a file.
"""
