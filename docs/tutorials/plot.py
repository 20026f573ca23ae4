"""Draws the columns of a CSV file over its first column: python3 plot.py FILE.csv FILE.svg "LABEL OF Y"

The heading's first name is the label of x, the other names are those of the curves. Empty cells and NaN are left out.
Columns whose name begins with "measured" are drawn as points."""

import sys

import numpy as np

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 720, 400, 70, 20, 40, 50
COLOURS = ["#440154", "#21918c", "#d1742f", "#3b528b", "#5ec962", "#888888"]


def ticks(low, high):
    """Round numbers from low to high, some six of them."""
    raw = (high - low) / 6
    step = min((m * 10.0 ** np.floor(np.log10(raw)) for m in (1, 2, 5, 10)), key=lambda s: abs(np.log(s / raw)))
    return step * np.arange(np.ceil(low / step - 1e-9), high / step + 1e-9)


def main(table, picture, label):
    with open(table) as file:
        names = file.readline().strip().split(",")
        rows = np.genfromtxt(file, delimiter=",", ndmin=2)
    x, columns = rows[:, 0], rows[:, 1:]
    (x0, x1), (y0, y1) = ((np.nanmin(a), np.nanmax(a)) for a in (x, np.append(columns, 0.0)))
    to_x = lambda v: LEFT + (v - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT)
    to_y = lambda v: HEIGHT - BOTTOM - (v - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM)
    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"',
           ' font-family="sans-serif" font-size="13">',
           f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
    text = lambda x, y, words, more: svg.append(f'<text x="{x:.0f}" y="{y:.0f}" {more}>{words}</text>')
    for v in ticks(x0, x1):
        svg.append(f'<path d="M{to_x(v):.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#dddddd"/>')
        text(to_x(v), HEIGHT - BOTTOM + 18, f"{v + 0:.6g}", 'text-anchor="middle"')
    for v in ticks(y0, y1):
        svg.append(f'<path d="M{LEFT} {to_y(v):.1f}H{WIDTH - RIGHT}" stroke="#dddddd"/>')
        text(LEFT - 8, to_y(v) + 4, f"{v + 0:.6g}", 'text-anchor="end"')
    text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 10, names[0], 'text-anchor="middle"')
    text(16, HEIGHT / 2, label, f'text-anchor="middle" transform="rotate(-90 16 {HEIGHT / 2:.0f})"')
    for k, (name, y) in enumerate(zip(names[1:], columns.T)):
        colour = COLOURS[k % len(COLOURS)]
        points = [(to_x(a), to_y(b)) for a, b in zip(x, y) if np.isfinite(a) and np.isfinite(b)]
        if name.startswith("measured"):
            svg += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.5" fill="{colour}"/>' for a, b in points]
        else:
            path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
            svg.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        text(LEFT + k * (WIDTH - LEFT - RIGHT) / (len(names) - 1), TOP - 16, name, f'fill="{colour}"')
    with open(picture, "w") as file:
        file.write("\n".join(svg + ["</svg>\n"]))


if __name__ == "__main__":
    main(*sys.argv[1:])
