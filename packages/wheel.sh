#!/usr/bin/env bash
# Builds the wheel of the Python package for this system: any CPython from 3.11 on, any Linux with a C library as new as
# this one's or newer.
# Usage: packages/wheel.sh [FOLDER]
set -euo pipefail
folder=$(realpath -m "${1:-$(dirname "$0")/../target/wheels}")
cd "$(dirname "$0")/../crates/python"

tools=$(realpath -m ../../target/python-tools)
[ -x "$tools/bin/maturin" ] || { python3 -m venv "$tools" && "$tools/bin/pip" install --quiet 'maturin>=1.7,<2'; }
assets=python/palpate/assets
rm -rf $assets
mkdir $assets
cp -r ../../assets/scenes ../../assets/gallery ../../assets/human-skeleton.toml $assets
rm $assets/gallery/*.py
"$tools/bin/maturin" build --release --out "$folder" >"$tools/log" 2>&1 || { cat "$tools/log" >&2; exit 1; }
ls -l "$folder"/palpate-*.whl
