#!/usr/bin/env bash
# Measures palpate on this machine within nine minutes, and writes results as it goes: index.html in the folder OUT, with
# a line for each part as soon as it ends. A part that runs out of its time is cut off, and the page says so.
# Usage: ./run.sh [OUT] [DEVICE]; DEVICE is a name or an index of `./palpate devices`.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=$(realpath -m "${1:-$here/results}")
mkdir -p "$out" || exit 1
cd "$here" || exit 1
# The loader of the machine, where there is one, knows its drivers best.
ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' || export LD_LIBRARY_PATH=$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
export PALPATE_CACHE=$here/bodies CARGO_MANIFEST_DIR=$here
device=()
if [ -n "${2-}" ]; then
    device=(--device "$2")
    export PALPATE_TEST_DEVICE=$2
fi
end=$((SECONDS + 540))
page=$out/index.html

begin_page() {
    {
        echo '<!doctype html><meta charset="utf-8"><title>palpate on this machine</title>'
        echo '<style>body{font:16px sans-serif;max-width:60em;margin:2em auto}td,th{text-align:left;padding:.2em 1em .2em 0;vertical-align:top}pre{margin:0;white-space:pre-wrap}</style>'
        echo "<h1>palpate on this machine</h1><p>Commit $(cut -c 1-12 commit), $(date -u '+%Y-%m-%d %H:%M') UTC, $(nproc) processors.</p>"
        echo '<table><tr><th>part</th><th>result</th><th>s</th><th>last lines</th></tr>'
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
        *) result="failed ($status)" ;;
    esac
    echo "$name: $result"
    local lines
    lines=$(tail -n 8 "$out/$name.log" | cut -c 1-200 | sed 's/&/\&amp;/g; s/</\&lt;/g')
    echo "<tr><td><a href='$name.log'>$name</a><td>$result<td>$((SECONDS - begun))<td><pre>$lines</pre></tr>" >>"$page"
    return $status
}

# As many steps as take some ten seconds, 3,000 at most.
scene() {
    local name=$1 path=$2 median
    rm -rf "$out/$name-$path" "$out/$name-$path-first"
    ./palpate run "assets/scenes/$name.toml" --depth "$path" --steps 40 "${device[@]}" --out "$out/$name-$path-first" || return
    median=$(cut -d, -f "$(head -n 1 "$out/$name-$path-first/trace.csv" | tr , '\n' | grep -nx step_us | cut -d: -f 1)" \
        "$out/$name-$path-first/trace.csv" | tail -n +2 | sort -n | sed -n 20p)
    rm -r "$out/$name-$path-first"
    local steps=$((10000000 / (${median%.*} + 1)))
    ./palpate run "assets/scenes/$name.toml" --depth "$path" --steps "$((steps < 3000 ? steps : 3000))" "${device[@]}" \
        --out "$out/$name-$path"
}
export -f scene
export out

begin_page
part devices 10 ./palpate devices --verbose
part selftest 120 ./palpate selftest "${device[@]}" --out "$out/selftest"
for name in touch-head touch-human two-heads gears pumpkins; do
    for path in compute graphics; do
        part "$name-$path" 25 bash -c "device=(${device[*]@Q}); scene $name $path"
    done
done
part kernels 100 ./vk-tests gpu:: stage:: solver::
part proximity 30 ./palpate bench proximity/area "${device[@]}" --out "$out/proximity"
part fem 60 ./palpate bench solver/block105k-20kPa-1ms solver/block105k-2MPa-1ms "${device[@]}" --out "$out/fem"
part million 40 ./palpate bench solver/scaling "${device[@]}" --out "$out/million"
part stability 60 ./palpate stability --quick "${device[@]}" --out "$out/stability"
echo '</table>' >>"$page"
echo "$page"
