#!/usr/bin/env bash
# Packs the sources of the last commit with compiled shaders, so that building from the archive takes Rust and a C linker,
# but no GLSL compiler: unpack it, then `cargo install --path crates/cli`.
# Usage: packages/source.sh [ARCHIVE]
set -euo pipefail
archive=$(realpath -m "${1:-$(dirname "$0")/../target/palpate-source.tar.xz}")
cd "$(dirname "$0")/.."

[ -z "$(git status --porcelain -- shaders crates/glsl)" ] ||
    { echo "$0: shaders or crates/glsl differ from the last commit; commit first" >&2; exit 1; }
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# The build script's folder, which holds a SPIR-V binary and the digest of its sources for each shader.
built=$(cargo build --release -p palpate --message-format=json-render-diagnostics |
    sed -n 's/.*"build-script-executed".*#palpate@.*"out_dir":"\([^"]*\)".*/\1/p' | tail -n 1)
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
git archive --prefix="palpate-$version/" HEAD | tar -x -C "$folder"
mkdir "$folder/palpate-$version/shaders/compiled"
cp "$built"/*.spv "$built"/*.sha256 "$folder/palpate-$version/shaders/compiled"
mkdir -p "$(dirname "$archive")"
tar -C "$folder" -cJf "$archive" "palpate-$version"
echo "$archive: $(($(stat -c %s "$archive") / 1000)) kB"
