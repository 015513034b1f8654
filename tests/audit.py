"""Bill of materials of the environment, and its known vulnerabilities: ``make audit``.

Writes a software bill of materials (CycloneDX) of `.venv` to ``build/sbom.json``, and asks the package
index for known vulnerabilities. A finding is printed and ends with status 0: it comes from outside, at
any time. Where the index cannot be reached, or does not answer, one line says so.
"""

import json
import subprocess
import sys
from pathlib import Path

TOP = Path(__file__).parents[1]
ENVIRONMENT, TOOLS, BILL = TOP / ".venv", TOP / "build" / "audit", TOP / "build" / "sbom.json"
PACKAGES = ("pip-audit>=2.7,<3", "cyclonedx-bom>=5,<8")


def run(*words):
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)


def main():
    installed = run(sys.executable, "-m", "venv", TOOLS)
    if installed.returncode == 0:
        installed = run(TOOLS / "bin" / "pip", "install", "--quiet", *PACKAGES)
    if installed.returncode:
        print("audit: nothing was checked, the package index gives no tools for it")
        return
    made = run(
        TOOLS / "bin" / "cyclonedx-py", "environment", ENVIRONMENT / "bin" / "python", "-o", BILL
    )
    if made.returncode:
        print(f"audit: no bill of materials could be made: {made.stderr.strip()[-300:]}")
    else:
        count = len(json.loads(BILL.read_text())["components"])
        print(f"audit: {count} packages are listed in {BILL.relative_to(TOP)}")
    places = run(
        ENVIRONMENT / "bin" / "python",
        "-c",
        "import sysconfig; print(sysconfig.get_path('purelib'))",
    )
    asked = run(
        TOOLS / "bin" / "pip-audit", "--path", places.stdout.strip(), "--format", "json",
        "--progress-spinner", "off", "--timeout", "10",
    )  # fmt: skip
    try:
        packages = json.loads(asked.stdout)["dependencies"]
    except (ValueError, KeyError):
        packages = []
    known = [each for each in packages if "skip_reason" not in each]
    if not known:
        print(
            "audit: the package index answers no question on vulnerabilities; nothing was checked"
        )
        return
    found = [
        f"audit: {each['name']} {each['version']} is vulnerable: {finding['id']}, "
        f"mended in {', '.join(finding['fix_versions']) or 'no release'}"
        for each in known
        for finding in each["vulns"]
    ]
    print("\n".join(found) or "audit: no known vulnerability")
    print(
        f"audit: {len(known)} of {len(packages)} packages are known to the index and were checked"
    )


if __name__ == "__main__":
    main()
