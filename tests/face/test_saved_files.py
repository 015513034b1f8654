"""Files of results: what is wrong with one is said in a line, and nothing in it is run."""

import io
import json
import tracemalloc
import zipfile

import numpy as np
import pytest

import rdpi_gym as rg


def document_of(path):
    with np.load(path, allow_pickle=False) as archive:
        return json.loads(archive["document"].tobytes()), {
            name: archive[name] for name in archive.files if name != "document"
        }


def write(path, document, arrays):
    text = np.frombuffer(json.dumps(document).encode(), dtype=np.uint8)
    np.savez(path, document=text, **arrays)
    return path


@pytest.fixture
def saved(model, tmp_path):
    return model.save(tmp_path / "fit.npz")


def refused(path):
    with pytest.raises(rg.InputError) as caught:
        rg.load_result(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    assert str(path) in message
    return message


def test_a_file_that_is_not_there(tmp_path):
    assert "does not exist" in refused(tmp_path / "none.npz")


def test_another_ending_is_refused_before_anything_is_written(model, tmp_path):
    with pytest.raises(rg.InputError, match=r"ends in \.npz"):
        model.save(tmp_path / "fit.json")
    assert list(tmp_path.iterdir()) == []


def test_an_archive_of_measured_columns_is_no_result(tmp_path):
    path = tmp_path / "record.npz"
    np.savez(path, t=np.arange(3.0), u=np.arange(3.0), y=np.arange(3.0))
    assert "no saved result" in refused(path)


def test_a_result_of_another_kind(saved, comparison):
    with pytest.raises(rg.InputError, match="'fit'; expected comparison"):
        rg.Comparison.load(saved)


@pytest.mark.parametrize("size", [0, 10, 400, -1])
def test_a_file_cut_off(saved, size):
    saved.write_bytes(saved.read_bytes()[:size])
    refused(saved)


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "os.system"},
        {"kind": ["fit"]},
        {"version": 2},
        {"version": "1"},
        {"format": "rdpi-plant"},
        {"result": None},
        {"result": []},
    ],
)
def test_a_changed_head(saved, change):
    document, arrays = document_of(saved)
    refused(write(saved, document | change, arrays))


@pytest.mark.parametrize(
    "change",
    [
        {"train_rmse_um": "much"},
        {"train_rmse_um": None},
        {"parameters": {"delta1_V": [1.0]}},
        {"warnings": 3},
        {"seconds": {}},
        {"model": {"name": "x"}},
        {"evaluations": 10**400},
        {"unknown": 1},
    ],
)
def test_a_field_of_another_type(saved, change):
    document, arrays = document_of(saved)
    document["result"] |= change
    refused(write(saved, document, arrays))


def test_a_field_that_is_missing(saved):
    document, arrays = document_of(saved)
    del document["result"]["rmse_um"]
    assert "rmse_um" in refused(write(saved, document, arrays))


def test_an_array_that_is_not_there(data, tmp_path_factory, subtests):
    for place in [-1, "a999", "document", 1.5, None, ["a0"]]:
        with subtests.test(place=place):
            tmp_path = tmp_path_factory.mktemp("case")
            path = data.save(tmp_path / "data.npz")
            document, arrays = document_of(path)
            document["result"]["records"][0]["u_V"] = place
            refused(write(path, document, arrays))


def test_pickled_objects_are_refused(data, tmp_path):
    path = data.save(tmp_path / "data.npz")
    document, arrays = document_of(path)
    document["result"]["records"][0]["u_V"] = "pickled"
    arrays["pickled"] = np.array([{"x": 1}], dtype=object)
    assert "Python objects" in refused(write(path, document, arrays))


def test_an_array_whose_header_promises_more_than_the_file_holds(data, tmp_path):
    path = data.save(tmp_path / "data.npz")
    document, arrays = document_of(path)
    document["result"]["records"][0]["u_V"] = "huge"
    write(path, document, arrays)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    )
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("huge.npy", header.getvalue() + bytes(8))
    assert "expands to" in refused(path)


def test_an_archive_that_expands_beyond_all_proportion(saved):
    document, arrays = document_of(saved)
    text = np.frombuffer(json.dumps(document).encode(), dtype=np.uint8)
    np.savez_compressed(saved, document=np.zeros(2**28, dtype=np.uint8), old=text, **arrays)
    assert "expands to" in refused(saved)


def test_a_deeply_nested_document(saved):
    text = np.frombuffer(b"[" * 100_000, dtype=np.uint8)
    np.savez(saved, document=text)
    refused(saved)


def test_the_rows_of_a_table_are_those_of_its_columns(scores, tmp_path_factory, subtests):
    for rows in [100_000_000, -1, 2.5, "many", None]:
        with subtests.test(rows=rows):
            tmp_path = tmp_path_factory.mktemp("case")
            path = scores.save(tmp_path / "scores.npz")
            document, arrays = document_of(path)
            table = document["result"]["table"]
            table["rows"] = rows
            tracemalloc.start()
            refused(write(path, document, arrays))
            assert tracemalloc.get_traced_memory()[1] < 2**24
            tracemalloc.stop()


def test_an_array_of_anything_but_numbers_is_refused(data, tmp_path_factory, subtests):
    for values in [["a", "b"], [1j, 2.0], np.array(["2020-01-01"], dtype="M8[s]"), [b"a"]]:
        with subtests.test(values=str(values)):
            tmp_path = tmp_path_factory.mktemp("case")
            path = data.save(tmp_path / "data.npz")
            document, arrays = document_of(path)
            document["result"]["records"][0]["u_V"] = "other"
            arrays["other"] = np.array(values)
            assert "arrays hold numbers" in refused(write(path, document, arrays))


def test_flipped_bits_give_a_result_or_one_line(saved):
    raw = saved.read_bytes()
    rng = np.random.default_rng(0)
    said = []
    for place in rng.integers(len(raw), size=300):
        damaged = bytearray(raw)
        damaged[place] ^= 1 << int(rng.integers(8))
        saved.write_bytes(bytes(damaged))
        try:
            rg.load_result(saved)
        except rg.InputError as error:
            said.append(str(error))
    assert all("\n" not in line and len(line) < 400 for line in said)
    assert len(said) > 100  # of an archive every member has a check sum


def test_checks_and_findings_are_saved_as_the_sentences_of_their_release(
    comparison, found, tmp_path
):
    for result, key, kept in (
        (comparison, "checks", {"sentence": "It creeps.", "next_step": "Wait."}),
        (found, "findings", {"sentence": "3 stand alone.", "next_step": "Look for contacts."}),
    ):
        path = result.save(tmp_path / f"{key}.npz")
        document, arrays = document_of(path)
        written = document["result"][key]
        assert [each.to_dict() for each in getattr(rg.load_result(path), key)] == written
        assert repr(rg.load_result(path)) == repr(result)
        for each in written:  # in other words
            each |= kept
        old = rg.load_result(write(path, document, arrays))
        assert [each.to_dict() for each in getattr(old, key)] == written


def test_a_check_without_its_sentence_or_in_no_zone_is_damage(comparison, tmp_path):
    path = comparison.save(tmp_path / "comparison.npz")
    document, arrays = document_of(path)
    for damage in ({"sentence": None}, {"zone": "perhaps"}, {"value": "much"}, {"suggests": 3}):
        changed = json.loads(json.dumps(document))
        changed["result"]["checks"][0] |= damage
        refused(write(path, changed, arrays))
