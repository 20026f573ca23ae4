#!/usr/bin/env bash
# Measures palpate on this machine within nine minutes, and writes results as it goes: index.html in the folder OUT, with
# a line for each part as soon as it ends. A part that runs out of its time is cut off, and what is left when the nine
# minutes are over is left out; the page says so. Exits with status 1 if a part failed.
# Usage: ./run.sh [OUT] [DEVICE]; DEVICE is a name or an index of `./palpate devices`.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=$(realpath -m "${1:-$here/results}")
mkdir -p "$out" || exit 1
cd "$here" || exit 1
# The loader of the machine, where there is one, knows its drivers best.
[ -n "$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p 2>/dev/null | grep 'libvulkan\.so\.1')" ] ||
    export LD_LIBRARY_PATH=$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
# Tests with planted faults compile shaders.
printf '#!/bin/sh\nLD_LIBRARY_PATH=%q exec %q "$@"\n' "$here/glslc" "$here/glslc/glslc" >"$out/glslc"
chmod +x "$out/glslc"
export GLSLC=$out/glslc PALPATE_CACHE=$here/bodies CARGO_MANIFEST_DIR=$here PALPATE_TEST_VALIDATION=off
device=()
if [ -n "${2-}" ]; then
    device=(--device "$2")
    export PALPATE_TEST_DEVICE=$2
fi
end=$((SECONDS + 540))
failed=0
page=$out/index.html

begin_page() {
    {
        echo '<!doctype html><meta charset="utf-8"><title>palpate on this machine</title>'
        echo '<style>body{font:16px sans-serif;max-width:60em;margin:2em auto}td,th{text-align:left;padding:.2em 1em .2em 0;vertical-align:top}pre{margin:0;white-space:pre-wrap}</style>'
        echo "<h1>palpate on this machine</h1><p>Commit $(cat commit), $(date -u '+%Y-%m-%d %H:%M') UTC, $(nproc) processors.</p>"
        echo '<table><tr><th>part</th><th>result</th><th>s</th><th>last lines (of stages: passes, median and 99th percentile, us)</th></tr>'
    } >"$page"
}

# part NAME SECONDS COMMAND...: runs the command for so many seconds at most; its output goes to NAME.log.
part() {
    local name=$1 most=$2 begun=$SECONDS left=$((end - SECONDS))
    shift 2
    if [ "$left" -lt 5 ]; then
        echo "<tr><td>$name<td>no time left<td><td></tr>" >>"$page"
        return 1
    fi
    timeout --kill-after=5 "$((most < left ? most : left))" "$@" >"$out/$name.log" 2>&1
    local status=$? result
    case $status in
        0) result=passed ;;
        124 | 137) result="cut off after $((SECONDS - begun)) s" ;;
        *)
            result="failed ($status)"
            failed=1
            ;;
    esac
    echo "$name: $result"
    local lines
    lines=$(tail -n 8 "$out/$name.log" | cut -c 1-200 | sed 's/&/\&amp;/g; s/</\&lt;/g')
    echo "<tr><td><a href='$name.log'>$name</a><td>$result<td>$((SECONDS - begun))<td><pre>$lines</pre></tr>" >>"$page"
    return $status
}

# run_scene FILE OUT OPTIONS...: as many steps as take some ten seconds, 10 at least and 3,000 at most.
run_scene() {
    local file=$1 to=$2 column median steps
    shift 2
    rm -rf "$to" "$to-first"
    ./palpate run "$file" --steps 9 "$@" --out "$to-first" || return
    column=$(head -n 1 "$to-first/trace.csv" | tr , '\n' | grep -nx step_us | cut -d: -f 1)
    median=$(cut -d, -f "$column" "$to-first/trace.csv" | tail -n +2 | sort -n | sed -n 5p)
    rm -r "$to-first"
    steps=$((10000000 / (${median%.*} + 1)))
    steps=$((steps < 10 ? 10 : steps))
    ./palpate run "$file" --steps "$((steps < 3000 ? steps : 3000))" "$@" --out "$to"
}
export -f run_scene

# block CELLS: a scene of a soft block with 6 CELLS^3 tetrahedra that hangs from its side.
block() {
    cat <<SCENE
[[body]]
name = "block"
layer = { box = [[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]], cells = [$1, $1, $1] }
material = { young = 2e4, poisson = 0.45, density = 1000.0, damping_stiffness = 0.002 }

[[body.core]]
name = "wall"
bind = { box = [[-1.0, -1.0, -1.0], [0.001, 1.0, 1.0]] }
SCENE
}

begin_page
part devices 10 ./palpate devices --verbose
part selftest 200 ./palpate selftest "${device[@]}" --out "$out/selftest"
for name in touch-head touch-human two-heads gears pumpkins; do
    for path in compute graphics; do
        part "$name-$path" 25 bash -c 'run_scene "$@"' run "assets/scenes/$name.toml" "$out/$name-$path" --depth "$path" \
            "${device[@]}"
    done
done
for cells in 26 55; do
    block "$cells" >"$out/block$cells.toml"
    part "block$cells" 60 bash -c 'run_scene "$@"' run "$out/block$cells.toml" "$out/block$cells" "${device[@]}"
done
part kernels 100 ./vk-tests gpu:: stage:: solver::
part proximity 60 ./palpate bench --quick proximity/area "${device[@]}" --out "$out/proximity"
part validate 60 ./palpate validate --quick --only patch,energy,cook,sofa-cantilever,le10 "${device[@]}" --out "$out/validate"
part stability 60 ./palpate stability --quick --only preset,contact-stiffness "${device[@]}" --out "$out/stability"
echo '</table>' >>"$page"
echo "$page"
exit "$failed"
