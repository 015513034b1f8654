#!/usr/bin/env bash
# Runs make as a stranger would: in a fresh clone of what is committed, with an empty home, an empty
# temporary folder and nothing of the caller's environment but the path and the package index.
#
#   tests/fresh.sh                 make bench, then make test
#   tests/fresh.sh test            one target
#   tests/fresh.sh "test test-all" two targets of one make
#   tests/fresh.sh --twice         each of them twice in a row
#
# Stops at the first target that fails, with its status. Prints how long each took, what lies in the
# home and the temporary folder afterwards, and fails if a target leaves something in the checkout.
set -euo pipefail
root=$(git -C "$(dirname "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
times=1
if [ "${1:-}" = --twice ]; then times=2; shift; fi
if [ $# = 0 ]; then set -- bench test; fi

# A short name: paths of sockets are limited to about a hundred characters.
work=$(mktemp -d /tmp/f.XXXXXX)
trap 'chmod -R u+w "$work"; rm -rf "$work"' EXIT
mkdir "$work/home" "$work/tmp"
git clone --quiet --no-local "$root" "$work/clone"
if [ -n "$(git -C "$root" status --porcelain)" ]; then
  echo "fresh: the checkout has changes that are not committed; they are not in the clone" >&2
fi

# A python found through a shim in the home would not be found from an empty one.
python=${PYTHON:-$(python3 -c 'import sys; print(sys.executable)')}
kept=(PATH="$PATH" HOME="$work/home" TMPDIR="$work/tmp" LANG=C.UTF-8)
while IFS='=' read -r name value; do
  case "$name" in PIP_* | RDPI_DATA | RDPI_ALL_TOOLS | CI) kept+=("$name=$value") ;; esac
done < <(env)

cd "$work/clone"
for target in "$@"; do
  for _ in $(seq "$times"); do
    begun=$(date +%s)
    env -i "${kept[@]}" make --no-print-directory PYTHON="$python" $target </dev/null
    echo "fresh: make $target took $(($(date +%s) - begun)) s"
    left=$(git status --porcelain)
    if [ -n "$left" ]; then
      printf 'fresh: make %s left in the checkout:\n%s\n' "$target" "$left" >&2
      exit 1
    fi
  done
done
echo "fresh: left in the home: $(find "$work/home" -mindepth 1 -maxdepth 2 -printf '%P ')"
echo "fresh: left in the temporary folder: $(find "$work/tmp" -mindepth 1 -maxdepth 1 -printf '%P ')"
