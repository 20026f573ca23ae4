#!/usr/bin/env bash
# Installs what a bare Debian or Ubuntu machine lacks:
#   ./setup.sh          to build and run palpate: a C compiler (for its linker), the GLSL compiler glslc, a Vulkan loader
#                       with Mesa's drivers (lavapipe among them), and the libraries that a window needs; one to three
#                       minutes
#   ./setup.sh --tests  and to run the tests: the validation layers, what the tests of the C interface compile and look
#                       with, and a display without a screen; two minutes more
#   ./setup.sh --full   and to run all that `.ci/run full` runs: ParaView; 500 MB more
# Silent when nothing is missing.
set -euo pipefail
cd "$(dirname "$0")"

packages=(build-essential pkg-config glslc libvulkan1 mesa-vulkan-drivers
    libx11-6 libx11-xcb1 libxcb1 libxcursor1 libxi6 libxrandr2 libxkbcommon0 libxkbcommon-x11-0)
tests=(clang valgrind cmake python3 python3-numpy python3-venv libvulkan-dev vulkan-validationlayers procps xvfb xdotool
    libegl1 libgl1-mesa-dri)
full=(python3-paraview xauth)
minutes="one to three minutes"
case "${1-}" in
    "") ;;
    --tests)
        packages+=("${tests[@]}")
        minutes="two to five minutes"
        ;;
    --full)
        packages+=("${tests[@]}" "${full[@]}")
        minutes="four to ten minutes"
        ;;
    *) echo "setup.sh: $1 is not known; give --tests or --full, or nothing" >&2; exit 2 ;;
esac

elsewhere() {
    cat >&2 <<'TEXT'
setup.sh knows Debian and Ubuntu only. On another system install, by its own means:
  - a Vulkan 1.3 loader and driver (Mesa's lavapipe will do), and the Khronos validation layer for the tests;
  - glslc, the command of shaderc (the Vulkan SDK has it); where it is in no usual place, name it in the environment
    variable GLSLC.
TEXT
    exit 1
}

command -v dpkg-query >/dev/null && command -v apt-get >/dev/null || elsewhere
command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs, then run this again." >&2; exit 1; }

missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
if [ "${#missing[@]}" -gt 0 ]; then
    echo "setup.sh: installing in $minutes: ${missing[*]}"
    root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || { echo "Not root, and no sudo: run as root: apt-get install ${missing[*]}" >&2; exit 1; }
        root=(sudo)
    fi
    "${root[@]}" apt-get update -qq
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${missing[@]}" >/dev/null
    echo "setup.sh: done in $SECONDS s"
fi
