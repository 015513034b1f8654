from dataclasses import replace

import numpy as np
import pytest

from benchmarks.effect_discovery.cases import Case
from benchmarks.effect_discovery.independent import INDEPENDENT
from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES, LOOKED, TEMPERATURE
from rdpi_gym.diagnosis.beam.ending import judged
from rdpi_gym.diagnosis.beam.evidence import Clock, Evidence, Offer, joined
from rdpi_gym.diagnosis.beam.expansion import offered
from rdpi_gym.diagnosis.beam.grades import names_of, takes_less
from rdpi_gym.diagnosis.beam.models import Linear, Model, Visited, refitted
from rdpi_gym.diagnosis.beam.moves import Place, bearable, exchanged, kinds, raced
from rdpi_gym.diagnosis.beam.openings import without_unknown_past
from rdpi_gym.diagnosis.beam.score import Blocks
from rdpi_gym.diagnosis.beam.search import Beam, Scores, begun, searched
from rdpi_gym.diagnosis.features.noise import measured_noise
from rdpi_gym.diagnosis.search.setting import Setting, assess
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, P10, RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.pinched_stop import PinchedStop
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from rdpi_gym.plant.effects.base import in_chain_order
from rdpi_gym.support.errors import InputError
from tests.looping import over

TS_S = 2e-3


def _records(model, samples=1200):
    """Two records of steps and ramps with noise of 10 nm, one to judge by."""
    found = []
    for k, role in enumerate(("train", "validation")):
        rng = np.random.default_rng(k)
        levels = np.repeat(40.0 * rng.uniform(-1.0, 1.0, samples // 60), 60)
        levels[:60] = 0.0
        u = np.convolve(levels, np.full(15, 1.0 / 15), mode="full")[:samples]
        y = Plant(model, TS_S).simulate(u) + 0.01 * rng.normal(size=samples)
        found.append(Record(f"steps-{k}", np.arange(samples) * TS_S, u, y, ts_s=TS_S, role=role))
    return found


@pytest.fixture(scope="module")
def crept():
    """Records of a plant with creep."""
    creep = CATALOGUE["creep"].forms[0](gain=0.05, time_constant_s=0.3)
    return Dataset("creep is hidden", tuple(_records(replace(P10, effects=(creep,)))))


def _searched(dataset):
    """Return the scores of all sets, the best one, and the grades of names."""
    _, scores, best = searched(Evidence.of(dataset))
    return scores, best, {each.name: each for each in names_of(scores, best)}


def test_nothing_is_named_where_nothing_is_hidden():
    _, best, names = _searched(Dataset("nothing is hidden", tuple(_records(P10))))
    assert not any(each.grade for each in names.values())
    assert best.rmse_um == pytest.approx(0.01, rel=0.1)


def test_what_the_records_to_judge_by_alone_show_is_fitted_there():
    rails = CATALOGUE["saturation"].forms[0](high_V=30.0)
    slow, fast = _records(replace(P10, effects=(rails,)))
    within = replace(slow, u_V=0.6 * slow.u_V)
    rng = np.random.default_rng(5)
    y = Plant(replace(P10, effects=(rails,)), TS_S).simulate(within.u_V)
    within = replace(within, y_um=y + 0.01 * rng.normal(size=y.size))
    beam, _, best = searched(Evidence.of(Dataset("rails", (within, fast))))
    assert [e.name for e in best.model.effects] == ["saturation"]
    assert best.rmse_um == pytest.approx(0.01, rel=0.1)
    assert beam.evidence.is_exchanged
    assert [r.name for r in beam.evidence.dataset.train] == [fast.name]
    (finding,) = (f for f in beam.evidence.findings if f.kind == "exchanged")
    assert finding.sentence == (
        "steps-0 agreed with the model to the noise and steps-1 did not: the model is fitted to steps-1 "
        "and validated on steps-0."
    )


def test_a_drift_that_went_otherwise_where_it_is_judged_is_refitted_to_both():
    drift = CATALOGUE["thermal_drift"]
    hidden = drift(rate_um_s=0.02, time_constant_s=50.0), drift(rate_um_s=1.0, time_constant_s=1.0)
    records = [_records(replace(P10, effects=(each,)))[k] for k, each in enumerate(hidden)]
    evidence = Evidence.of(Dataset("two experiments", tuple(records)))
    one = refitted(evidence, Model(begun(evidence).model.core, (hidden[0],)))
    fit = fit_joint(evidence.train, one.model.core, (hidden[0],))
    bare = assess(Setting(evidence.train, evidence.validation, evidence.scale), "", fit).errors
    errors = judged(evidence, one).errors
    assert max(errors.train_rmse_um, errors.validation_rmse_um) < 0.6 * bare.validation_rmse_um
    assert errors.validation_rmse_um < np.sqrt(np.mean(one.lefts[1] ** 2))


@pytest.mark.slow
def test_creep_is_named_and_its_probability_is_the_weight_of_its_sets(crept):
    scores, best, names = _searched(crept)
    assert [n for n, each in names.items() if each.grade in ("found", "likely")] == ["creep"]
    base = next(one for one in scores.sets if one.parent is None)
    assert best.model.core.name == "rdpi"
    assert best.rmse_um < 0.1 * base.rmse_um
    weights = scores.probabilities.mean(axis=0)
    having = ["creep" in one.model.names for one in scores.sets]
    assert names["creep"].probability == pytest.approx(weights[having].sum())
    assert weights.sum() == pytest.approx(1.0)
    assert len({len(scores.of(one)) for one in scores.sets}) == 1


def test_a_phantom_of_creep_gains_next_to_nothing_of_what_creep_does(crept):
    evidence = Evidence.of(crept)
    base = begun(evidence)
    look = Place(evidence, base.model).look_at(CATALOGUE["creep"].starts(evidence.scale)[:1])
    with_creep = refitted(evidence, look.model, base.key)
    linear = Linear(evidence, Variant(base.model.core, base.model.effects))
    ghosts = linear.with_phantoms(with_creep.model, ["creep"])
    alone, *ghosts = [np.mean(np.concatenate(lefts) ** 2) for lefts in ghosts]
    gain = np.log(alone / with_creep.rmse_um**2)
    assert gain > 1.0
    assert all(np.log(alone / ghost) < 0.2 * gain for ghost in ghosts)


def test_what_promises_most_beside_the_core_is_the_effect_that_is_there(crept):
    evidence = Evidence.of(crept)
    base = begun(evidence)
    place = Place(evidence, base.model, offered(evidence, base))
    asked = place.additions()
    assert {start.name for (start,) in asked[:2]} == {"creep"}
    assert len({start.name for (start,) in asked}) <= LOOKED
    seen = place.look_at(asked[1])
    assert seen.new == ("creep",)
    assert np.std(np.concatenate(seen.lefts)) < 0.3 * base.rmse_um


def test_a_mode_between_two_starts_promises_most():
    """On the standard protocol one that rings at another frequency promises nothing: a broad one does."""
    case = Case("single", ("resonance",), 0, 0, "plain")
    evidence = Evidence.of(INDEPENDENT.prepare(case).dataset)
    base = begun(evidence)
    (first,), *_ = Place(evidence, base.model, offered(evidence, base)).additions()
    assert first.name == "resonance"


def _first_study(study, *effects, number=0):
    """Records of a plant of the first study, and the effects that are hidden in it."""
    prepared = INDEPENDENT.prepare(Case(study, effects, number, 0, "plain"))
    hidden = [{**each} for each in prepared.truth["hidden"]]
    kinds = [CATALOGUE[each.pop("effect")] for each in hidden]
    pairs = zip(kinds, hidden, strict=True)
    found = in_chain_order([kind.within_bounds(**own) for kind, own in pairs])
    return Evidence.of(prepared.dataset), found


def test_a_refit_goes_on_where_gains_act_through_a_bend():
    """It compares squares that were simulated: those that the best gains promise no step reached."""
    evidence, hidden = _first_study("pairs", "resonance", "asymmetry")
    core = RDPI.comb(evidence.scale)
    fit = fit_joint(evidence.train, core, hidden, 15, samples=FIT_SAMPLES)
    assert fit.train_rmse_um == pytest.approx(0.0147, rel=0.05)
    assert [e.name for e in fit.variant.effects] == ["asymmetry", "resonance"]


def test_a_slew_limit_is_looked_at_across_the_valleys_about_its_start():
    """From 17 % above, where every number follows a wrong limit, as from its own place."""
    evidence, (limit,) = _first_study("single", "slew_limit", number=5)
    place = Place(evidence, begun(evidence).model)
    far = replace(limit, rate_V_s=1.17 * limit.rate_V_s)
    look = place.look_at((far,))
    assert look.model.effects[0].rate_V_s == pytest.approx(limit.rate_V_s, rel=1e-3)
    left_um = np.sqrt(np.mean(np.concatenate(look.lefts) ** 2))
    assert left_um == pytest.approx(evidence.floor_um(look.lefts), rel=0.2)
    alone = fit_joint(evidence.train, place.model.core, (far,), samples=FIT_SAMPLES)
    assert alone.train_rmse_um > 5.0 * left_um  # no gradient leads there


def test_noise_at_the_floor_of_many_blocks_pays_for_no_effect():
    blocks, rng = Blocks((32,) * 15), np.random.default_rng(0)
    noise = tuple(rng.normal(size=1600) for _ in range(15))
    at_floor = Visited(BARE, None, noise)
    above = replace(at_floor, lefts=tuple(1.05 * left for left in noise))
    scores = Scores((at_floor, above), blocks, 1.0, np.ones(15), 0)
    # without what noise scores, as much as an effect has to gain
    assert scores.of(at_floor).sum() > TEMPERATURE * scores._price
    assert scores.is_at_floor(at_floor)
    assert not scores.is_at_floor(above)


def test_a_backlash_is_looked_at_though_no_step_from_a_start_promises_it():
    hidden = replace(P10, effects=(CATALOGUE["backlash"](1.0),))
    evidence = Evidence.of(Dataset("backlash is hidden", tuple(_records(hidden))))
    base = begun(evidence)
    place = Place(evidence, base.model, offered(evidence, base))
    assert CATALOGUE["backlash"] not in {type(start) for (start,) in place.names()}
    looks = [place.look_at(starts) for starts in place.additions() if starts[0].name == "backlash"]
    assert base.rmse_um > 0.017
    assert all(np.std(np.concatenate(look.lefts)) < 0.011 for look in looks if look)  # the noise
    assert any(looks)


def test_the_drop_of_an_effect_that_is_there_is_not_borne_and_the_best_look_of_a_name_goes_on(
    crept,
):
    evidence = Evidence.of(crept)
    place = Place(evidence, begun(evidence).model)
    bare = place.stepped()
    looks = [
        place.look_at(creep.starts(evidence.scale)[:1])
        for creep in forms_of(CATALOGUE["creep"])[:3]
    ]
    assert len(raced(bare, looks, evidence, 4)) == 1
    assert bearable(looks[1], [bare, looks[1]], evidence) == [looks[1]]


def test_a_late_record_is_mended_by_the_delay_of_its_own_clock(crept):
    (record, _) = crept.train[0], crept.validation
    late = replace(record, u_V=np.interp(record.t_s + 0.01, record.t_s, record.u_V))
    mended = Clock("delay", record.name, 0.01).mended(late)
    assert mended.u_V[20:-20] == pytest.approx(record.u_V[20:-20], abs=1e-9)
    other = Clock("delay", "another", 0.01)
    assert other.mended(late) is late
    assert Model(P10.hysteresis, clocks=(other,)).names == {"clock delay of another"}


def test_a_fault_of_a_clock_has_phantoms_that_gain_next_to_nothing(crept):
    (record, *rest) = crept.records
    late = replace(record, u_V=np.interp(record.t_s + 0.01, record.t_s, record.u_V))
    evidence = Evidence.of(Dataset("one clock is fast", (late, *rest)))
    base = begun(evidence)
    clock = Clock("delay", record.name, 0.01)
    mended = refitted(evidence, replace(base.model, clocks=(clock,)), base.key)
    linear = Linear(evidence, Variant(base.model.core, base.model.effects))
    found = linear.with_phantoms(mended.model, [clock.name])
    alone, *ghosts, alike = [np.mean(np.concatenate(lefts) ** 2) for lefts in found]
    gain = np.log(alone / mended.rmse_um**2)
    assert gain > 0.3
    assert len(ghosts) == 2
    assert all(np.log(alone / ghost) < 0.2 * gain for ghost in ghosts)
    assert np.log(alone / alike) < 0.8 * gain  # the same fault of all records


def test_openings_of_records_that_begin_in_motion_are_left_out_and_those_of_others_are_not():
    train, validation = _records(P10)
    t = np.arange(2400) * TS_S
    u = 45.0 * np.sin(2.0 * np.pi * 0.5 * t) + 10.0 * np.sin(2.0 * np.pi * 2.3 * t)
    y = Plant(P10, TS_S).simulate(u) + 0.01 * np.random.default_rng(9).normal(size=t.size)
    moving = [
        replace(
            train, name=f"from {k}", t_s=t[k:] - t[k], u_V=u[k:], y_um=y[k:],
            error_mask=np.zeros(0, dtype=np.bool_),
        )
        for k in (650, 1500)
    ]  # fmt: skip
    evidence = Evidence.of(Dataset("two begin in motion", (*moving, validation)))
    spared = without_unknown_past(evidence, begun(evidence))
    assert spared is not None
    assert begun(spared).rmse_um < 0.5 * begun(evidence).rmse_um
    once = joined(spared.dataset)
    assert [r.name for r in once.records] == [r.name for r in evidence.dataset.records]
    counted = [sum(r.error_mask.sum() for r in d.records) for d in (once, spared.dataset)]
    assert counted[0] == counted[1] < sum(r.error_mask.sum() for r in evidence.dataset.records)
    still = replace(evidence, noise=measured_noise([(np.zeros(100), "repeated values")], ()))
    with np.errstate(divide="raise", invalid="raise"):  # the floor is zero
        assert without_unknown_past(still, begun(still)) is not None
    sound = Evidence.of(Dataset("all begin at rest", (train, validation)))
    assert without_unknown_past(sound, begun(sound)) is None


def test_a_memory_that_leaves_its_opening_above_the_rest_gives_way_to_leaving_it_out():
    train, validation = _records(P10)
    t = np.arange(2400) * TS_S
    u = 45.0 * np.sin(2.0 * np.pi * 0.5 * t) + 10.0 * np.sin(2.0 * np.pi * 2.3 * t)
    y = Plant(P10, TS_S).simulate(u) + 0.01 * np.random.default_rng(9).normal(size=t.size)
    moving = replace(
        train,
        t_s=t[650:] - t[650],
        u_V=u[650:],
        y_um=y[650:],
        error_mask=np.zeros(0, dtype=np.bool_),
    )
    pasts = CATALOGUE["initial_memory"]
    for record, past, gives_way in ((moving, pasts(5.0), True), (train, pasts(5.0), False)):
        evidence = Evidence.of(Dataset("one record", (record, validation)))
        base = begun(evidence)
        remembering = refitted(evidence, replace(base.model, effects=(past,)), base.key)
        assert (without_unknown_past(evidence, remembering) is not None) == gives_way


def test_a_clock_that_leaves_the_floats_is_a_set_less_and_not_the_end(crept):
    evidence = Evidence.of(crept)
    wild = Clock("step", crept.train[0].name, 1e4)
    assert refitted(evidence, Model(RDPI.comb(evidence.scale), clocks=(wild,))) is None


CREEP = CATALOGUE["creep"].within_bounds()
BARE = Model(P10.hysteresis)


def _scores(*sets):
    return Scores(sets, Blocks((16,)), 1.0, np.ones(1), 0)


def _visited(model, left, **of):
    """A set that leaves as much of every sample, or of each of its blocks."""
    return Visited(model, None, (np.resize(left, (10, 16)).T.ravel(),), **of)


@pytest.mark.parametrize(("left_um", "grade"), [(1.5, False), (4.0, True)])
def test_a_name_that_takes_less_than_its_set_leaves_is_no_cause(left_um, grade):
    bare, best = _visited(BARE, 5.0), _visited(Model(P10.hysteresis, (CREEP,)), left_um)
    assert takes_less(_scores(bare, best), best, "creep") is grade


def test_a_name_is_likely_where_it_or_one_that_takes_its_weight_is():
    """Each of two leaves nothing on the blocks where the other leaves much: they do not tell which it is."""
    delay = CATALOGUE["delay"].within_bounds()
    lefts = np.tile([1.0, 3.0], 8), np.tile([3.0, 1.0], 8)
    one, other = (
        _visited(Model(P10.hysteresis, (kind,)), left)
        for kind, left in zip((CREEP, delay), lefts, strict=True)
    )
    scores = _scores(_visited(BARE, 50.0), one, other)
    names = {best.key: {n.name: n for n in names_of(scores, best)} for best in (one, other)}
    creep, late = names[one.key]["creep"], names[other.key]["delay"]
    assert min(creep.probability, late.probability) < 0.5
    assert (creep.instead, creep.grade) == (("delay",), "likely")
    assert (late.instead, late.grade) == (("creep",), "likely")
    assert creep.shared == late.shared == pytest.approx(1.0)
    both = _visited(Model(P10.hysteresis, (CREEP, delay)), 1.0)
    beside = names_of(_scores(_visited(BARE, 50.0), one, other, both), both)
    assert not any(name.instead for name in beside)  # none of them is in the place of the other


def test_a_name_that_completes_another_one_is_found_by_independent_values_and_likely_by_others():
    delay = CATALOGUE["delay"].within_bounds()
    one, both = (Model(P10.hysteresis, effects) for effects in ((CREEP,), (CREEP, delay)))
    sets = _visited(BARE, 50.0), _visited(one, 4.0), _visited(both, 1.5)
    white = _scores(*sets)
    repeating = replace(white, independent=np.full(16, 0.2))
    for scores, grade in ((white, "found"), (repeating, "likely")):
        names = {each.name: each.grade for each in names_of(scores, sets[-1])}
        assert names == {"creep": "found", "delay": grade}
    assert repeating.weights == pytest.approx(white.weights)  # the search goes on by these


@pytest.mark.parametrize(
    ("before_um", "after_um", "better"),
    [
        (np.full(16, 5.0), np.full(16, 3.0), True),
        (np.full(16, 5.0), np.full(16, 4.8), False),  # less than one effect more costs
        (np.full(16, 5.0), np.tile([4.0, 6.0], 8), False),
        (np.array([1e4] + [5.0] * 15), np.full(16, 5.0), True),  # not drawn in a third of the draws
        (np.array([10.0] + [5.0] * 15), np.full(16, 5.0), False),
    ],
)
def test_a_set_is_accepted_where_it_outweighs_its_parent_in_however_few_blocks_it_gains(
    crept, before_um, after_um, better
):
    bare = _visited(BARE, before_um)
    move = _visited(Model(P10.hysteresis, (CREEP,)), after_um, parent=bare.key)
    beam = Beam(Evidence.of(crept), visited={bare.key: bare})
    beam.add([move])
    beam.accept([move], _scores(bare, move))
    assert (move.key in beam.accepted) is better


@pytest.mark.parametrize(("phantom_um", "better"), [(4.9, True), (3.0, False)])
def test_a_move_gains_what_its_best_phantom_does_not(phantom_um, better):
    bare, gain = _visited(BARE, 5.0), np.tile([2.5, 3.5], 8)
    ghosts = tuple((np.full(160, each),) for each in (5.0, 5.0, phantom_um))
    move = _visited(
        Model(P10.hysteresis, (CREEP,)), gain, parent=bare.key, ghosts=ghosts, new=("creep",)
    )
    assert _scores(bare, move).outweighs(move, bare) is better


def test_sets_that_leave_the_same_weigh_by_their_priors():
    bare, more = _visited(BARE, 5.0), _visited(Model(P10.hysteresis, (CREEP,)), 5.0)
    fewer, with_creep = _scores(bare, more).weights.mean(axis=0)
    of_one_name = len(CATALOGUE) + 1  # sets: an effect, or a clock fault
    assert with_creep / fewer == pytest.approx(1.0 / of_one_name)


def test_a_clock_fault_is_one_name_among_effects_and_each_record_and_kind_a_form_of_it():
    fault = Clock("skew", "")
    of_four = replace(
        _scores(_visited(BARE, 5.0), _visited(replace(BARE, clocks=(fault,)), 5.0)), faults=4
    )
    fewer, with_fault = of_four.weights.mean(axis=0)
    assert with_fault / fewer == pytest.approx(1.0 / (4.0 * (len(CATALOGUE) + 1)))


def test_the_stage_of_a_lag_is_tried_before_the_plays_with_its_numbers(crept):
    lag = CATALOGUE["sensor_lag"].within_bounds(time_constant_s=2e-3)
    scale = Evidence.of(crept).scale
    first, *further = [
        model.effects[0] for model in exchanged(Model(P10.hysteresis, (lag,)), scale, Offer())
    ]
    assert (first.name, first.values) == ("actuator_lag", lag.values)
    delays = forms_of(CATALOGUE["delay"])
    assert {type(e) for e in further} == {*CATALOGUE["actuator_lag"].forms, *delays}


@over("kind", [CATALOGUE["resonance"], CATALOGUE["delay"], *forms_of(CATALOGUE["slew_limit"])[2:]])
def test_the_lag_of_a_stage_is_tried_as_every_stage_of_one_time(crept, kind):
    """So is that of an amplifier whose current is limited: no slow ramp shows the limit."""
    stage, scale = kind(), Evidence.of(crept).scale
    ramp = np.arange(4000) * 1e-5
    assert ramp[-1] - stage.run(ramp, 1e-5)[-1] == pytest.approx(stage.slow_lag_s, rel=0.05)
    placed = [m.effects[0] for m in exchanged(Model(P10.hysteresis, (stage,)), scale, Offer())]
    others = {"actuator_lag", "sensor_lag", "delay"} - {kind.name}
    kinds = {form for other in others for form in forms_of(CATALOGUE[other])}
    assert {type(each) for each in placed} == kinds
    simplest = [each for each in placed if not each.form]
    assert [each.slow_lag_s for each in simplest] == pytest.approx([stage.slow_lag_s] * len(others))


def test_a_data_set_without_records_that_move_is_refused():
    t = np.arange(200) * TS_S
    rest = Record("rest", t, np.zeros(200), np.zeros(200), ts_s=TS_S)
    with pytest.raises(InputError, match="needs records to fit and to validate on"):
        Evidence.of(Dataset("rest", (rest,)))


def test_a_kind_that_is_behind_after_a_few_steps_is_fitted_to_its_end():
    """With a mode missing, a pinched stop begins behind a stop model and ends ahead of it."""
    core = PinchedStop((0.7, 2.6, 0.8, 1.0, 1.1, 2.3, 2.6, 2.1, 1.9, 1.1, 2.3, 2.0), 18.0)
    mode = CATALOGUE["resonance"].within_bounds(f0_hz=38.0, damping=0.07)
    plant = PlantModel(core, "pinched", (-25.0, 25.0), (0.0, 40.0), effects=(mode,))
    t = np.arange(2500) * TS_S
    loops = 24.0 * np.sin(np.pi * t / t[-1]) * np.sin(2.0 * np.pi * 0.9 * t)
    chirp = 20.0 * np.sin(2.0 * np.pi * (0.5 * t + 0.7 * t**2))
    records = [
        Record(name, t, u, Plant(plant, TS_S).simulate(u), ts_s=TS_S)
        for name, u in (("loops", loops), ("chirp", chirp))
    ]
    evidence = Evidence.of(Dataset("a mode is missing", tuple(records)))
    base = refitted(evidence, Model(CORES["stop"].comb(evidence.scale)))
    found, _ = kinds(evidence, base.model, base.fit.train_rmse_um, loose=False)
    assert "pinched_stop" in {model.core.name for model in found}
