#!/usr/bin/env bash
# Packs what install.sh installs, the scenes and the licences into an archive that can be unpacked anywhere, and the same
# into a Debian package.
# Usage: packages/archive.sh [FOLDER]
set -euo pipefail
folder=$(realpath -m "${1:-$(dirname "$0")/../target/packages}")
cd "$(dirname "$0")/.."

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
name=palpate-$version-$(uname -m)-$(uname -s | tr '[:upper:]' '[:lower:]')
prefix=$work/$name
mkdir -p "$folder"

./install.sh --prefix "$prefix" >/dev/null
strip "$prefix/bin/palpate"
strip --strip-unneeded "$prefix"/lib/libpalpate.so.*
strip --strip-debug "$prefix/lib/libpalpate.a"
mkdir -p "$prefix/share/palpate" "$prefix/share/doc/palpate"
cp -r assets/scenes assets/gallery assets/human-skeleton.toml "$prefix/share/palpate"
rm "$prefix"/share/palpate/gallery/*.py
cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$prefix/share/doc/palpate"
python3 packages/licences.py palpate-cli palpate-capi >"$prefix/share/doc/palpate/copyright"
tar -C "$work" -cJf "$folder/$name.tar.xz" "$name"

# The same files below /usr.
architecture=$(dpkg --print-architecture)
debian=$work/debian
mkdir -p "$debian/DEBIAN"
cp -r "$prefix" "$debian/usr"
libc=$(objdump -T "$prefix/bin/palpate" | sed -n 's/.*GLIBC_\([0-9.]*\).*/\1/p' | sort -V | tail -n 1)
cat >"$debian/DEBIAN/control" <<TEXT
Package: palpate
Version: $version
Architecture: $architecture
Maintainer: the authors of palpate
Depends: libc6 (>= $libc), libgcc-s1, libvulkan1
Recommends: mesa-vulkan-drivers
Section: science
Priority: optional
Description: feel soft bodies: deformable contact and haptic forces on any Vulkan 1.3 device
 A haptic device moves a rigid tool; the engine finds where the tool meets deformable skin, deforms the body by finite
 elements in Vulkan compute shaders, and returns force and torque. Without a GPU, Mesa's software driver will do.
TEXT
chmod -R u+rwX,go+rX,go-w "$debian"
dpkg-deb --root-owner-group --build "$debian" "$folder/palpate_${version}_$architecture.deb" >/dev/null
ls -l "$folder"
