"""Fingerprints change with what the code does, and with nothing else."""

from rdpi_gym.support.fingerprint import code_parts, fingerprint

SOURCE = '''"""A module."""
import os


class Law:
    """Ts, in seconds."""

    cause = "Domains switch ever more slowly."
    x: float = 1.0
    """A weight (µm/V)."""

    def at(self, v):
        "The law."
        from math import sqrt
        if v < 0:
            raise ValueError(f"v is {v}; give 0 or more")
        return sqrt(v) * self.x  # Eq. 4
'''


def stamp(folder, name, text):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return fingerprint(code_parts([folder / name]))


def test_comments_docstrings_imports_and_places_change_nothing(tmp_path_factory, subtests):
    for old, new in [
        ('"""A module."""', '"""Another sentence."""'),
        ("# Eq. 4", "# Eq. 5"),
        ("Domains switch", "Most domains switch"),
        ("; give 0 or more", " V/s, but a rate is never below zero"),
        ("import os", "import pathlib\nfrom os import sep"),
        ('    """A weight (µm/V)."""\n', ""),
        ('        "The law."\n', ""),
        ("        from math import sqrt\n", ""),
        ("\n\n\nclass", "\n\n\n\n\nclass"),
    ]:
        with subtests.test(old=old, new=new):
            tmp_path = tmp_path_factory.mktemp("case")
            assert old in SOURCE
            before = stamp(tmp_path, "a.py", SOURCE)
            assert stamp(tmp_path, "room/b.py", SOURCE.replace(old, new)) == before


def test_what_the_code_does_changes_it(tmp_path_factory, subtests):
    for old, new in [("1.0", "2.0"), ("sqrt(v)", "v"), ("self.x", "self.y")]:
        with subtests.test(old=old, new=new):
            tmp_path = tmp_path_factory.mktemp("case")
            assert stamp(tmp_path, "a.py", SOURCE) != stamp(
                tmp_path, "a.py", SOURCE.replace(old, new)
            )
