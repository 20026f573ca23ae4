#!/usr/bin/env bash
# Fuzzes each target for some seconds, under AddressSanitizer and with libFuzzer's guidance by coverage.
# Usage: fuzz/run.sh SECONDS [TARGET..]; a finding leaves its input in fuzz/artifacts/TARGET and ends the script with an error.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:?"usage: fuzz/run.sh SECONDS [TARGET..]"}
shift
targets=("$@")
[ "${#targets[@]}" -gt 0 ] || mapfile -t targets < <(sed -n 's/^name = "\([a-z]*\)"$/\1/p' Cargo.toml)

# The same versions of libraries as the program's.
cp ../Cargo.lock .
# The flags are those of a nightly compiler, which a stable one accepts in this way.
host=$(rustc -vV | sed -n 's/^host: //p')
export RUSTC_BOOTSTRAP=1
export RUSTFLAGS="--cfg fuzzing -Zsanitizer=address -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
-Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1"
cargo build --release --quiet --target "$host" $(printf -- '--bin %s ' "${targets[@]}")
built=${CARGO_TARGET_DIR:-target}/$host/release

# Mesa and its compiler keep memory for the life of the process.
export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1
for target in "${targets[@]}"; do
    mkdir -p "corpus/$target" "artifacts/$target"
    seeds=()
    for folder in "seeds/$target" "../assets/${target}s"; do
        [ -d "$folder" ] && seeds+=("$folder")
    done
    echo "$target: $seconds s"
    "$built/$target" -max_total_time="$seconds" -timeout=60 -rss_limit_mb=4096 -max_len=65536 -print_final_stats=1 \
        -artifact_prefix="artifacts/$target/" "corpus/$target" "${seeds[@]}" >"artifacts/$target.log" 2>&1 ||
        { tail -n 30 "artifacts/$target.log" >&2; exit 1; }
    grep -E "stat::number_of_executed_units|calls of the C ABI" "artifacts/$target.log" | tail -n 2
done
