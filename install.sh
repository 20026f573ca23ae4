#!/usr/bin/env bash
# Builds palpate and puts it where other programs find it:
#   ./install.sh [--prefix DIR] [--built DIR]
# The folder after --prefix, by default target/install, gets bin/palpate, include/palpate.h and palpate.hpp,
# lib/libpalpate (shared, with the version in its name, and static), lib/pkgconfig/palpate.pc and lib/cmake/palpate; this folder can be moved as a whole.
# With --built nothing is built: the libraries and the program are taken from the folder after --built.
set -euo pipefail
cd "$(dirname "$0")"

fail() {
    echo "install.sh: $1" >&2
    exit 2
}

prefix=target/install
built=
while [ "$#" -gt 0 ]; do
    case "$1" in
        --prefix) prefix=${2-} ;;
        --built) built=${2-} ;;
        *) fail "$1 is not known; give --prefix DIR, --built DIR, or nothing" ;;
    esac
    [ "$#" -ge 2 ] || fail "$1 needs a folder"
    shift 2
done
[ -n "$prefix" ] || fail "--prefix is empty; give a folder"
if [ -z "$built" ]; then
    cargo build --release
    built=${CARGO_TARGET_DIR:-target}/release
fi

case "$(uname -s)" in
    Linux) shared=libpalpate.so made=libpalpate_capi.so system="-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc" ;;
    Darwin) shared=libpalpate.dylib made=libpalpate_capi.dylib system="-framework CoreFoundation -liconv -lm" ;;
    *) fail "only Linux and macOS are known; elsewhere link with the library that cargo build --release makes" ;;
esac
for file in "$made" libpalpate_capi.a palpate; do
    [ -s "$built/$file" ] || fail "$built has no $file; build with cargo build --release"
done
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)

mkdir -p "$prefix"/{bin,include,lib/pkgconfig,lib/cmake/palpate}
install -m 755 "$built/palpate" "$prefix/bin/palpate"
install -m 644 crates/capi/src/palpate.h crates/capi/src/palpate.hpp "$prefix/include/"
# The file's name has the version; programs are linked with the name without it.
case "$shared" in
    *.so) versioned=$shared.$version ;;
    *) versioned=${shared%.dylib}.$version.dylib ;;
esac
rm -f "$prefix/lib/$shared"
install -m 755 "$built/$made" "$prefix/lib/$versioned"
ln -s "$versioned" "$prefix/lib/$shared"
[ "$(uname -s)" != Darwin ] || install_name_tool -id "@rpath/$shared" "$prefix/lib/$shared"
install -m 644 "$built/libpalpate_capi.a" "$prefix/lib/libpalpate.a"
fill() {
    sed -e "s|@VERSION@|$version|g" -e "s|@SHARED@|$shared|g" -e "s|@SYSTEM_LIBRARIES@|$system|g" \
        "crates/capi/src/package/$1.in" >"$prefix/$2/$1"
}
fill palpate.pc lib/pkgconfig
fill palpate-config.cmake lib/cmake/palpate
fill palpate-config-version.cmake lib/cmake/palpate
echo "palpate $version is in $prefix"
