"""A row once written is never changed unnoticed: every single flipped bit of a store."""

import pytest

from benchmarks.rows import TRACKING
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import RowStore, named_rows

NAMED = [
    {"key": f"creep/{k}", "value": 0.1 + k / 3, "verdict": "explained", "noise_µm": [k, 1e-3]}
    for k in range(5)
]
SCORED = [
    {
        "controller": "none", "plant": "P5", "reference": "sine", "frequency_hz": 10.0 * k,
        "ts_s": 1e-3, "seed": k, "rmse_um": 1.0 / (k + 1), "status": "ok", "code": "0123456789abcdef",
    }
    for k in range(1, 6)
]  # fmt: skip


def scored(path):
    return RowStore(path, TRACKING.name, TRACKING.key)


@pytest.mark.parametrize(
    ("opened", "rows"), [(named_rows, NAMED), (scored, SCORED)], ids=["named", "tracking"]
)
def test_every_single_flipped_bit_is_noticed(opened, rows, tmp_path):
    path = tmp_path / "rows.jsonl"
    opened(path).append(rows)
    whole, content = opened(path).rows, path.read_bytes()
    counts = {"row computed again": 0, "file refused": 0, "harmless": 0, "silent": 0}
    for bit in range(8 * len(content)):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            store = opened(path)
        except InputError:
            counts["file refused"] += 1
            continue
        assert store.rows.items() <= whole.items()  # what comes back is what was written
        if store.damaged:
            assert "computed again" in store.remark()
            counts["row computed again"] += 1
        else:
            counts["harmless" if store.rows == whole else "silent"] += 1
    print(f"{8 * len(content)} single flipped bits: {counts}")
    assert sum(counts.values()) >= 3000
    assert counts["silent"] == counts["file refused"] == 0


def test_a_flipped_bit_costs_its_own_row_alone(tmp_path):
    path = tmp_path / "rows.jsonl"
    named_rows(path).append(NAMED)
    content = path.read_bytes()
    place = content.index(b'"value": 0.1')
    path.write_bytes(content[:place] + content[place:].replace(b"0.1", b"0.3", 1))
    store = named_rows(path)
    assert list(store.rows.values()) == NAMED[1:]
    store.append(NAMED[:1])
    assert {row["key"]: row for row in NAMED} == named_rows(path).rows


def test_a_line_that_nobody_wrote_is_no_row(tmp_path):
    path = tmp_path / "rows.jsonl"
    named_rows(path).append(NAMED)
    content = path.read_bytes()
    for change in (b"{}", b"null", b"[1]", b'{"key": 3}', b'{"key": "a"}', b"\xff"):
        path.write_bytes(content + change + b"\n")
        store = named_rows(path)
        assert (len(store.rows), store.damaged) == (len(NAMED), 1), change
        assert store.remark() == (
            "1 row was damaged in rows.jsonl, cut off or changed since written; it is computed again."
        )
