#!/usr/bin/env bash
# Checks that the program compiles for Windows and macOS; nothing is linked or run. A target's standard library is rustup's
# (`rustup target add TARGET`) or, where the compiler's sources are installed (rust-src), is built for the check; without
# either, the target is skipped and said so.
set -euo pipefail
cd "$(dirname "$0")/.."
libraries=$(rustc --print sysroot)/lib/rustlib

for target in x86_64-pc-windows-gnu aarch64-apple-darwin; do
    if [ -d "$libraries/$target" ]; then
        cargo check --release --target "$target" -p palpate-cli
    elif [ -d "$libraries/src/rust/library" ]; then
        RUSTC_BOOTSTRAP=1 cargo check --release -Zbuild-std=std,panic_unwind --target "$target" -p palpate-cli
    else
        echo "$0: skipped: no standard library for $target here: rustup target add $target" >&2
    fi
done
