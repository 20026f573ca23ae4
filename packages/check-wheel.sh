#!/usr/bin/env bash
# Makes the wheel, installs it into a fresh environment, and runs the Python tests and the strict type check. With the word
# full it runs the tests with ParaView too, which `setup.sh --full` installs.
set -euo pipefail
cd "$(dirname "$0")/.."
case "${1-}" in
    "") tests=(-m "not paraview") ;;
    full) tests=() ;;
    *) echo "$0: $1 is not known; give full, or nothing" >&2; exit 2 ;;
esac

rm -rf target/wheels
packages/wheel.sh target/wheels
environment=$PWD/target/python-check
python3 -m venv --clear "$environment"
"$environment/bin/pip" install --quiet target/wheels/palpate-*.whl pytest pyright distributed pyarrow nbclient \
    ipykernel matplotlib meshio pyvista usd-core mcap mcap-protobuf-support
cd crates/python
"$environment/bin/pyright" --pythonpath "$environment/bin/python"
"$environment/bin/python" -m pytest --quiet "${tests[@]}" tests
