#!/usr/bin/env bash
# Packs into one archive what measures palpate on a machine that has a Vulkan driver and nothing else: the program, the
# tests of kernels, scenes, prepared bodies, a Vulkan loader, and run.sh, which does everything in nine minutes.
# Usage: crates/bench/pack/make.sh [ARCHIVE]
set -euo pipefail
archive=$(realpath -m "${1:-$(dirname "$0")/../../../target/palpate-pack.tar.xz}")
cd "$(dirname "$0")/../../.."

cargo build --release -p palpate-cli
tests=$(cargo test --release --test vk-tests --no-run 2>&1 | sed -n 's/.*Executable vk-tests.*(\(.*\))$/\1/p')
program=$(dirname "$tests")/../palpate
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
pack=$folder/palpate-pack
mkdir -p "$pack/lib" "$pack/bodies"
strip -o "$pack/palpate" "$program"
strip -o "$pack/vk-tests" "$tests"
cp crates/bench/pack/run.sh "$pack"
cp "$(ldconfig -p | sed -n 's/.*libvulkan\.so\.1 .*=> //p' | head -n 1)" "$pack/lib/libvulkan.so.1"
cp -r assets shaders "$pack"
# Tests with planted faults compile shaders.
glslc=$(command -v "${GLSLC:-glslc}")
mkdir "$pack/glslc"
cp "$glslc" $(ldd "$glslc" | awk '/libshaderc|libstdc|libgcc_s/ {print $3}') "$pack/glslc"
git describe --always --abbrev=12 --dirty >"$pack/commit"
for scene in assets/scenes/*.toml; do
    PALPATE_CACHE=$pack/bodies "$pack/palpate" run "$scene" --explain >"$folder/explained"
done
tar -C "$folder" -cJf "$archive" palpate-pack
bytes=$(stat -c %s "$archive")
[ "$bytes" -lt 40000000 ] || { echo "$0: $archive has $bytes bytes; 40 MB at most" >&2; exit 1; }
echo "$archive: $((bytes / 1000000)) MB"
