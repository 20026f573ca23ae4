#!/usr/bin/env bash
# Makes the wheel, installs it into a fresh environment, and runs the Python tests and the strict type check.
set -euo pipefail
cd "$(dirname "$0")/.."

rm -rf target/wheels
packages/wheel.sh target/wheels
environment=$PWD/target/python-check
python3 -m venv --clear "$environment"
"$environment/bin/pip" install --quiet target/wheels/palpate-*.whl pytest pyright distributed pyarrow nbclient \
    ipykernel matplotlib meshio pyvista usd-core mcap mcap-protobuf-support
cd crates/python
"$environment/bin/pyright" --pythonpath "$environment/bin/python"
"$environment/bin/python" -m pytest --quiet tests
