"""Lists the licences of all crates that are in a package: python3 packages/licences.py PACKAGE...

Prints name, version and licence of every dependency of these packages of the workspace, then the texts of the licences,
each once."""

import json
import subprocess
import sys
from pathlib import Path


def main() -> None:
    """Print the list."""
    command = ["cargo", "metadata", "--format-version", "1", "--filter-platform", "x86_64-unknown-linux-gnu"]
    metadata = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    edges = {
        node["id"]: [
            dependency["pkg"]
            for dependency in node["deps"]
            if any(kind["kind"] in (None, "normal") for kind in dependency["dep_kinds"])
        ]
        for node in metadata["resolve"]["nodes"]
    }
    waiting = [key for key, package in packages.items() if package["name"] in sys.argv[1:]]
    if len(waiting) < len(sys.argv) - 1 or not waiting:
        sys.exit(f"licences.py: give names of packages of the workspace, not {sys.argv[1:]}")
    found: set[str] = set()
    while waiting:
        key = waiting.pop()
        if key not in found:
            found.add(key)
            waiting += edges[key]
    foreign = sorted((packages[key] for key in found if packages[key]["source"]), key=lambda p: (p["name"], p["version"]))
    texts: dict[str, list[str]] = {}
    print("palpate is licensed under MIT or Apache-2.0, as you like. It contains the following crates.\n")
    for package in foreign:
        name = f"{package['name']} {package['version']}"
        print(f"{name}: {package['license'] or 'see the text below'}")
        for file in sorted(Path(package["manifest_path"]).parent.glob("*")):
            if file.is_file() and file.name.upper().startswith(("LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE")):
                texts.setdefault(file.read_text(errors="replace").strip(), []).append(name)
    for text, names in texts.items():
        print(f"\n{'-' * 80}\n{', '.join(dict.fromkeys(names))}\n{'-' * 80}\n\n{text}")


if __name__ == "__main__":
    main()
