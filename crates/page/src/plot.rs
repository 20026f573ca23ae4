//! Plots of the reports, as SVG. The colours are those of M. Okabe and K. Ito (2008), which colour-blind readers can
//! distinguish; the text is drawn with the fonts of the reader's computer.

use palpate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width and height of a plot, pixels.
const SIZE: (u32, u32) = (760, 420);
/// Height of a bar and of the gap between it and the next bar together, pixels.
const BAR_HEIGHT: u32 = 30;
/// Least and greatest number of ticks of a logarithmic axis: more would overlap, fewer would not show the scale.
const TICKS: std::ops::RangeInclusive<usize> = 3..=7;
/// Leading digits of the ticks of a logarithmic axis, in sets from sparse to dense.
const DIGITS: [&[f64]; 5] = [
    &[1.0],
    &[1.0, 3.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
    &[1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
];
/// Bound of the relative rounding error of a power of ten.
const ROUNDING: f64 = 1e-9;
/// Height of a row of panels (plots side by side), pixels.
const PANEL_HEIGHT: u32 = 300;
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(230, 159, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];
const FONT: (&str, u32) = ("sans-serif", 15);
/// Width and height of a curve's plot, pixels.
const CURVE_SIZE: (u32, u32) = (1080, 680);
/// Font of a curve's plot; the plot is shown at half its size.
const LARGE: (&str, u32) = ("sans-serif", 40);
/// A curve with at most this many points has a dot at each point.
const FEW: usize = 40;
/// Greatest number of decimal places of a number on a curve's axis; a number that needs more is written with an
/// exponent.
const MOST_DIGITS: i32 = 4;
/// Width of the room for the names of bars, as a share of the plot's width.
const LABELS: f64 = 0.28;
/// Width of the room for the names of lines, to the right of their ends, pixels.
const NAMES: u32 = 80;
/// Upper end of the vertical axis of a plot with linear axes, divided by the y of its highest point.
const HEADROOM: f64 = 1.12;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A line of a plot, drawn through its points.
#[derive(Debug, Clone, Default)]
pub struct Line {
    /// Name, written at the end of the line.
    pub name: String,
    /// Points, in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Range of each point's x, drawn as a horizontal bar through the point; empty: no ranges are drawn.
    pub ranges: Vec<[f64; 2]>,
}

/// The horizontal axis of [`lines`].
#[derive(Debug, Clone)]
pub struct Axis {
    /// Label, with its unit.
    pub label: String,
    /// Names that are written at 0, 1, 2 and so on; empty: numbers are written.
    pub names: Vec<String>,
}

/// Draws lines on linear axes, each with its name at its end; the first line is thicker than the others.
pub fn lines(x: &Axis, y_label: &str, lines: &[Line]) -> Result<String> {
    to_svg(SIZE, |area| draw_lines(area, x, y_label, lines))
}

/// A bar of a plot.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Name, written to the left of the bar.
    pub name: String,
    /// Length from 0, in the unit of the axis.
    pub length: f64,
    /// Index of the colour; all bars of one kind have the same colour.
    pub kind: usize,
}

/// Draws horizontal bars, the first at the top, each with its name and length.
pub fn bars(x_label: &str, bars: &[Bar]) -> Result<String> {
    to_svg((SIZE.0, 90 + BAR_HEIGHT * bars.len() as u32), |area| draw_bars(area, x_label, bars))
}

/// The logarithmic axes that all plots of [`panels`] share.
#[derive(Debug, Clone, Copy)]
pub struct Logarithmic<'a> {
    /// Label of the horizontal axis, with its unit.
    pub x: &'a str,
    /// Label of the vertical axis, with its unit.
    pub y: &'a str,
    /// A value of y to compare with, drawn as a dashed line.
    pub level: Option<f64>,
}

/// One of several plots side by side.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title above the plot.
    pub title: String,
    /// Lines; points that are not above zero are left out.
    pub lines: Vec<Line>,
}

/// Draws plots side by side, two in a row, with the same logarithmic axes.
pub fn panels(axes: &Logarithmic, panels: &[Panel]) -> Result<String> {
    let columns = panels.len().clamp(1, 2);
    let rows = panels.len().div_ceil(columns).max(1);
    let height = if columns == 1 { SIZE.1 } else { PANEL_HEIGHT * rows as u32 };
    to_svg((SIZE.0, height), |area| {
        let areas = area.split_evenly((rows, columns));
        areas.iter().zip(panels).try_for_each(|(area, panel)| draw_panel(area, axes, panel, &spans(axes, panels)))
    })
}

/// A curve of a quantity of a simulation's run, drawn by [`curve`].
#[derive(Debug, Clone, Copy)]
pub struct Curve<'a> {
    /// What the plot shows, in words, for readers who have the page read aloud.
    pub title: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub x: &'a str,
    /// Label of the vertical axis, with its unit.
    pub y: &'a str,
    /// Points, in the units of the axes; points that are not finite are left out.
    pub points: &'a [(f64, f64)],
    /// A point with a name, drawn as a dot.
    pub mark: Option<((f64, f64), &'a str)>,
}

/// Draws a curve on linear axes that include 0. The plot is meant to be shown at half its size or less: the coordinates
/// of the curve's points are then finer than a pixel, and text is readable on a phone.
pub fn curve(curve: &Curve) -> Result<String> {
    let svg = to_svg(CURVE_SIZE, |area| draw_curve(area, curve))?;
    let title = crate::page::escaped(curve.title);
    Ok(svg.replacen("<svg ", &format!("<svg role=\"img\" aria-label=\"{title}\" "), 1))
}

type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

fn to_svg(size: (u32, u32), draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    let drawn = area.fill(&WHITE).map_err(Into::into).and_then(|()| draw(&area)).and_then(|()| Ok(area.present()?));
    drop(area);
    drawn.map_err(|error| Error::Simulation(format!("a plot cannot be drawn: {error}")))?;
    Ok(svg)
}

fn draw_lines(area: &Area, x: &Axis, y_label: &str, lines: &[Line]) -> Drawn {
    let points = || lines.iter().flat_map(|line| &line.points);
    let high = points().fold((0.0, 0.0), |high: (f64, f64), p| (high.0.max(p.0), high.1.max(p.1)));
    let margin = if x.names.is_empty() { 0.0 } else { 0.15 };
    let span = -margin..(high.0 + margin).max(1e-9);
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).margin_right(NAMES).x_label_area_size(44).y_label_area_size(60);
    let mut chart = builder.build_cartesian_2d(span, 0.0..(HEADROOM * high.1).max(1e-9))?;
    let name = |at: &f64| match x.names.get(at.round() as usize) {
        Some(name) if (at - at.round()).abs() < 1e-6 && *at > -0.5 => name.clone(),
        Some(_) => String::new(),
        None if x.names.is_empty() => number(*at),
        None => String::new(),
    };
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(&x.label).y_desc(y_label).label_style(FONT).axis_desc_style(FONT);
    mesh.x_label_formatter(&name).y_label_formatter(&|at| number(*at));
    mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12));
    if !x.names.is_empty() {
        mesh.disable_x_mesh().x_labels(x.names.len());
    }
    mesh.draw()?;
    for (k, line) in lines.iter().enumerate() {
        let style = COLOURS[k % COLOURS.len()].stroke_width(if k == 0 { 3 } else { 2 });
        chart.draw_series(LineSeries::new(line.points.iter().copied(), style))?;
        let dot = |&at: &(f64, f64)| Circle::new(at, if k == 0 { 4 } else { 3 }, style.filled());
        chart.draw_series(line.points.iter().map(dot))?;
    }
    let ends = lines.iter().enumerate().filter_map(|(k, line)| Some((k, chart.backend_coord(line.points.last()?))));
    draw_names(area, lines, ends.collect())
}

fn draw_curve(area: &Area, curve: &Curve) -> Drawn {
    let finite = |(x, y): &&(f64, f64)| x.is_finite() && y.is_finite();
    let points: Vec<(f64, f64)> = curve.points.iter().filter(finite).copied().collect();
    let [x, y] = [|p: &(f64, f64)| p.0, |p: &(f64, f64)| p.1].map(|of| span(points.iter().map(of)));
    let mut builder = ChartBuilder::on(area);
    builder.margin(20).margin_right(36).x_label_area_size(116).y_label_area_size(160);
    let mut chart = builder.build_cartesian_2d(x.clone(), y.clone())?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(curve.x).y_desc(curve.y).label_style(LARGE).axis_desc_style(LARGE).x_labels(6).y_labels(6);
    let [of_x, of_y] = [x, y].map(|span| span.end - span.start);
    let (x_ticks, y_ticks) = (|at: &f64| tick(*at, of_x), |at: &f64| tick(*at, of_y));
    mesh.x_label_formatter(&x_ticks).y_label_formatter(&y_ticks);
    mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12).stroke_width(2)).draw()?;
    let colour = COLOURS[2];
    chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(3)))?;
    if points.len() <= FEW {
        chart.draw_series(points.iter().map(|&at| Circle::new(at, 7, colour.filled())))?;
    }
    if let Some((at, name)) = curve.mark.filter(|((x, y), _)| x.is_finite() && y.is_finite()) {
        chart.draw_series([Circle::new(at, 9, COLOURS[1].filled())])?;
        let ((x, y), (left, top)) = (chart.backend_coord(&at), area.get_base_pixel());
        // The name stands on the side of the point where there is more room.
        let (side, away) = if x > CURVE_SIZE.0 as i32 / 2 { (HPos::Right, -16) } else { (HPos::Left, 16) };
        let style = TextStyle::from(LARGE.into_font()).color(&COLOURS[1]).pos(Pos::new(side, VPos::Bottom));
        area.draw_text(name, &style, (x - left + away, y - top - 4))?;
    }
    Ok(())
}

/// The range of an axis for these numbers: it contains 0 and all of the numbers, with room beyond an end that is not 0.
fn span(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = numbers.fold((0.0, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    let room = (HEADROOM - 1.0) * (high - low);
    match (low < 0.0, high > 0.0) {
        (false, false) => 0.0..1.0,
        (below, above) => low - if below { room } else { 0.0 }..high + if above { room } else { 0.0 },
    }
}

/// The text at a tick of an axis: the number `x` with as many digits as tell the ticks apart, where the axis has a
/// range of the length `length`.
fn tick(x: f64, length: f64) -> String {
    let digits = (1.0 - length.log10()).ceil() as i32;
    // A number that differs from 0 only by rounding is written as 0.
    if x.abs() < 1e-9 * length {
        return "0".into();
    }
    match digits {
        ..=0 if x.abs() >= 1e6 => format!("{x:.1e}"),
        ..=MOST_DIGITS => {
            let text = format!("{x:.*}", digits.max(0) as usize);
            let trimmed = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
            trimmed.into()
        }
        _ => format!("{x:.1e}"),
    }
}

/// Draws the names of lines at the lines' ends, from the lowest end up, so that no name overlaps the one below it.
fn draw_names(area: &Area, lines: &[Line], mut ends: Vec<(usize, (i32, i32))>) -> Drawn {
    ends.sort_by_key(|&(k, (_, y))| (std::cmp::Reverse(y), k));
    let mut free = i32::MAX;
    for (k, (x, y)) in ends {
        let y = y.min(free);
        free = y - FONT.1 as i32;
        let style = TextStyle::from(FONT.into_font()).color(&COLOURS[k % COLOURS.len()]);
        let (left, top) = area.get_base_pixel();
        area.draw_text(&lines[k].name, &style.pos(Pos::new(HPos::Left, VPos::Center)), (x - left + 10, y - top))?;
    }
    Ok(())
}

fn is_drawn(&(x, y): &(f64, f64)) -> bool {
    x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()
}

/// Ranges of the axes that all panels share; the y range ends at whole powers of ten.
fn spans(axes: &Logarithmic, panels: &[Panel]) -> [std::ops::Range<f64>; 2] {
    let all = panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| &line.points).copied().filter(is_drawn);
    let nothing = [[f64::INFINITY, 0.0]; 2];
    let grown = |[low, high]: [f64; 2], x: f64| [low.min(x), high.max(x)];
    let [x, mut y] = all.fold(nothing, |[xs, ys], (x, y)| [grown(xs, x), grown(ys, y)]);
    let bars = panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| line.ranges.as_flattened()).copied();
    let x = bars.filter(|end| *end > 0.0 && end.is_finite()).fold(x, grown);
    if let Some(level) = axes.level {
        y = grown(y, level);
    }
    let span = |[low, high]: [f64; 2]| if low <= high { low..high } else { 1.0..10.0 };
    let (x, y) = (span(x), span(y));
    let tens = |x: f64, way: fn(f64) -> f64| 10f64.powf(way(x.log10()));
    // The y range is a little wider than from one power of ten to another, so that rounding leaves neither of these
    // powers outside.
    let (low, high) = (tens(y.start, |l| (l - 0.1).floor()), tens(y.end, |l| (l + 0.1).ceil()));
    [x.start / 1.5..x.end * 1.5, low * (1.0 - ROUNDING)..high * (1.0 + ROUNDING)]
}

fn draw_panel(area: &Area, axes: &Logarithmic, panel: &Panel, [x, y]: &[std::ops::Range<f64>; 2]) -> Drawn {
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).margin_right(NAMES).x_label_area_size(44).y_label_area_size(66).caption(&panel.title, FONT);
    let keyed = |span: &std::ops::Range<f64>| span.clone().log_scale().with_key_points(ticks(span));
    let mut chart = builder.build_cartesian_2d(keyed(x), keyed(y))?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(axes.x).y_desc(axes.y).label_style(FONT).axis_desc_style(FONT);
    mesh.x_label_formatter(&|at| power(*at)).y_label_formatter(&|at| power(*at));
    mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).draw()?;
    if let Some(level) = axes.level {
        let ends = [(x.start, level), (x.end, level)];
        chart.draw_series(DashedLineSeries::new(ends, 5, 4, BLACK.mix(0.5).stroke_width(1)))?;
    }
    let mut ends = Vec::new();
    for (k, line) in panel.lines.iter().enumerate() {
        let points: Vec<(f64, f64)> = line.points.iter().copied().filter(is_drawn).collect();
        let style = COLOURS[k % COLOURS.len()].stroke_width(2);
        chart.draw_series(LineSeries::new(points.iter().copied(), style))?;
        chart.draw_series(points.iter().map(|&at| Circle::new(at, 3, style.filled())))?;
        let bars = line.points.iter().zip(&line.ranges).filter(|(at, [low, _])| is_drawn(at) && *low > 0.0);
        let thin = COLOURS[k % COLOURS.len()].mix(0.45).stroke_width(1);
        chart.draw_series(bars.map(|((_, y), [low, high])| PathElement::new([(*low, *y), (*high, *y)], thin)))?;
        ends.extend(points.last().map(|at| (k, chart.backend_coord(at))));
    }
    draw_names(area, &panel.lines, ends)
}

/// Round numbers within a range, for the ticks of an axis: the sparsest set of [`DIGITS`] that gives enough numbers is
/// used. If this set gives too many, only every second number, or every third and so on, is kept.
fn ticks(span: &std::ops::Range<f64>) -> Vec<f64> {
    let powers = span.start.log10().floor() as i32..=span.end.log10().ceil() as i32;
    let of = |digits: &[f64]| -> Vec<f64> {
        let all = powers.clone().flat_map(|power| digits.iter().map(move |digit| digit * 10f64.powi(power)));
        all.filter(|tick| span.contains(tick)).collect()
    };
    let all = DIGITS.iter().map(|digits| of(digits)).find(|ticks| ticks.len() >= *TICKS.start());
    let all = all.unwrap_or_else(|| of(DIGITS[DIGITS.len() - 1]));
    all.iter().copied().step_by(all.len().div_ceil(*TICKS.end()).max(1)).collect()
}

/// A number as [`number`] writes it, or with an exponent of ten if it is below 0.1 or at least 10,000.
fn power(x: f64) -> String {
    if (0.1..1e4).contains(&x) { number(x) } else { format!("{x:.0e}") }
}

fn draw_bars(area: &Area, x_label: &str, bars: &[Bar]) -> Drawn {
    let high = bars.iter().fold(0.0, |high: f64, bar| high.max(bar.length));
    let count = bars.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size((LABELS * f64::from(SIZE.0)) as u32)
        .build_cartesian_2d(0.0..(1.15 * high).max(1e-9), 0.0..count.max(1.0))?;
    // Each bar's name is drawn as text beside the middle of the bar, since the ticks of the axis need not lie there.
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(x_label).label_style(FONT).axis_desc_style(FONT).y_labels(0).disable_y_mesh();
    mesh.x_label_formatter(&|at| number(*at));
    mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).draw()?;
    chart.draw_series(bars.iter().enumerate().map(|(k, bar)| {
        let top = count - k as f64;
        let colour = COLOURS[(bar.kind + 1) % COLOURS.len()];
        Rectangle::new([(0.0, top - 0.15), (bar.length, top - 0.85)], colour.filled())
    }))?;
    for (k, bar) in bars.iter().enumerate() {
        let middle = count - k as f64 - 0.5;
        let (x, y) = chart.backend_coord(&(0.0, middle));
        let style = |h: HPos| TextStyle::from(FONT.into_font()).pos(Pos::new(h, VPos::Center));
        area.draw_text(&bar.name, &style(HPos::Right), (x - 8, y))?;
        let (end, y) = chart.backend_coord(&(bar.length, middle));
        area.draw_text(&number(bar.length), &style(HPos::Left), (end + 6, y))?;
    }
    Ok(())
}

/// A number with at most two digits after the point, without trailing zeros.
fn number(x: f64) -> String {
    let text = format!("{x:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_say_what_they_show() {
        let axis = Axis { label: "vertices".into(), names: vec!["11 k".into(), "44 k".into()] };
        let line = Line { name: "total".into(), points: vec![(0.0, 1.0), (1.0, 1.25)], ..Line::default() };
        let svg = lines(&axis, "ms", &[line]).unwrap();
        assert!(["vertices", "11 k", "44 k", "total"].iter().all(|text| svg.contains(text)), "wrong SVG: {svg}");
        let bar = |name: &str, length, kind| Bar { name: name.into(), length, kind };
        let svg = bars("time, ms", &[bar("one", 1.5, 0), bar("two", 3.0, 1)]).unwrap();
        assert!(["time, ms", "one", "two", "1.5"].iter().all(|text| svg.contains(text)), "wrong SVG: {svg}");
        assert!(lines(&axis, "ms", &[]).is_ok() && bars("ms", &[]).is_ok());
    }

    #[test]
    fn a_curve_is_drawn_for_any_points() {
        let draw = |points: &[(f64, f64)]| {
            let mark = points.last().map(|at| (*at, "peak <1>"));
            curve(&Curve { title: "a & b", x: "time, s", y: "force, N", points, mark }).unwrap()
        };
        let svg = draw(&[(0.0, 0.0), (0.1, 2e-3), (0.2, 1e-3)]);
        let parts = ["time, s", "force, N", "peak &lt;1&gt;", "<polyline", "<circle", "a &amp; b", "role=\"img\""];
        assert!(parts.iter().all(|part| svg.contains(part)), "wrong SVG: {svg}");
        for points in [&[][..], &[(0.0, 0.0)], &[(0.001, 5.0)], &[(1.0, -3.0)], &[(f64::NAN, 1.0)], &[(1e9, 1e-9)]] {
            assert!(!draw(points).contains("NaN"), "NaN in the plot of {points:?}");
        }
        let [both, none, above] = [&[1.0, -1.0][..], &[], &[2.0, 1.0]].map(|numbers| span(numbers.iter().copied()));
        assert!((both.start + 1.24).abs() < 1e-12 && both.start == -both.end, "wrong range: {both:?}");
        assert!(none == (0.0..1.0) && above.start == 0.0 && (above.end - 2.24).abs() < 1e-12, "wrong range: {above:?}");
        let ticks = [(0.5, 2.24), (2e-3, 4e-3), (2e-7, 1e-6), (3e4, 1e5), (0.3 - 0.2 - 0.1, 1.0), (-1.5, 2.0)];
        assert_eq!(ticks.map(|(x, length)| tick(x, length)), ["0.5", "0.002", "2.0e-7", "30000", "0", "-1.5"]);
    }

    #[test]
    fn panels_are_logarithmic_and_leave_out_what_has_no_logarithm() {
        let line = |points: &[(f64, f64)]| Line { name: "jacobi".into(), points: points.to_vec(), ..Line::default() };
        let panel = |title: &str, points: &[(f64, f64)]| Panel { title: title.into(), lines: vec![line(points)] };
        let axes = Logarithmic { x: "ms", y: "error", level: Some(1e-4) };
        let drawn = [panel("soft", &[(20.0, 3e-6), (7.0, 0.0), (8.0, f64::NAN)]), panel("stiff", &[(4.0, 2e-5)])];
        let svg = panels(&axes, &drawn).unwrap();
        assert!(
            ["soft", "stiff", "jacobi", "error", "1e-5", "10"].iter().all(|text| svg.contains(text)),
            "wrong SVG: {svg}"
        );
        let y = &spans(&axes, &drawn)[1];
        assert!((y.start / 1e-6 - 1.0).abs() < 1e-8 && (y.end / 1e-3 - 1.0).abs() < 1e-8, "range of the y axis: {y:?}");
        assert!(!svg.contains("NaN") && panels(&axes, &[]).is_ok() && panels(&axes, &[panel("none", &[])]).is_ok());
    }

    #[test]
    fn axes_have_enough_ticks_and_not_too_many() {
        assert_eq!(ticks(&(0.9..2e3)), [1.0, 10.0, 100.0, 1e3]);
        assert_eq!(ticks(&(9.0..70.0)), [10.0, 20.0, 50.0]);
        assert_eq!(ticks(&(13.0..21.0)), [14.0, 16.0, 18.0, 20.0]);
        assert_eq!(ticks(&(0.9e-9..1.1e3)).len(), 7, "ticks from 1e-9 to 1e3, at every second power of ten");
        assert_eq!([1e-5, 0.2, 1.4, 5e4].map(power), ["1e-5", "0.2", "1.4", "5e4"]);
    }
}
