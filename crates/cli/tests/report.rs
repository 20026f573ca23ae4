//! Tests of the results of `palpate run`, through the built program: the closing lines on the terminal, the entry
//! `felt` of `summary.json`, and the page `report.html`. The *tool* is the rigid body that the haptic device leads; a
//! *flag* marks what went wrong in a step; a *stage* is a part of a step whose time is measured.

use std::fs;
use std::path::Path;
use std::process::Command;

use roxmltree::{Document, ParsingOptions};
use serde_json::Value;

/// A soft block that stands on a table.
const BLOCK: &str = "[[body]]\nname = \"block\"\n\
    layer = { box = [[-0.05, -0.05, -0.05], [0.05, 0.0, 0.05]], cells = [6, 3, 6] }\n\
    material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
    [[body.core]]\nname = \"core\"\nmotion = \"fixed\"\nbind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.04, 1.0]] }\n";
/// A tool, a sphere, that starts above the block and is led down into it.
const PRESS: &str = "[tool]\nsphere = 0.02\nmass = 0.05\nposition = [0.0, 0.021, 0.0]\n\
    [coupling]\nstiffness = 500.0\ndamping = 5.0\n\
    [drive]\nkeys = [[0.0, 0.0, 0.021, 0.0], [0.03, 0.0, 0.01, 0.0]]\n";

/// What a run printed and wrote.
struct Ran {
    lines: Vec<String>,
    summary: Value,
    page: String,
    trace: Vec<csv::StringRecord>,
}

impl Ran {
    fn line(&self, at: usize) -> &str {
        &self.lines[at]
    }

    /// The text of the page without its markup, after checks that hold for every page: it is well-formed, it has no
    /// script, and it refers to no other file or site.
    fn text(&self) -> String {
        let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
        let document = Document::parse_with_options(&self.page, options).unwrap();
        for node in document.descendants().filter(roxmltree::Node::is_element) {
            assert!(
                !matches!(node.tag_name().name(), "script" | "link" | "iframe"),
                "wrong element: {:?}",
                node.tag_name()
            );
            for attribute in node.attributes() {
                let (name, value) = (attribute.name(), attribute.value());
                assert!(!name.starts_with("on") && !value.contains("url("), "wrong attribute {name} = {value}");
                let refers = matches!(name, "src" | "href" | "srcset" | "action" | "data");
                assert!(!refers || value.starts_with("data:image/png;base64,"), "wrong attribute {name} = {value}");
            }
        }
        let style = document.descendants().find(|node| node.has_tag_name("style")).unwrap().text().unwrap();
        assert!(!style.contains("url(") && !style.contains("@import"), "the style refers to another file: {style}");
        let body = document.descendants().find(|node| node.has_tag_name("body")).unwrap();
        let text: Vec<&str> =
            body.descendants().filter(roxmltree::Node::is_text).filter_map(|node| node.text()).collect();
        text.join(" ").split_whitespace().collect::<Vec<_>>().join(" ")
    }

    fn figures(&self, caption: &str) -> usize {
        self.page.matches(&format!("<figcaption>{caption}")).count()
    }

    fn pictures(&self) -> usize {
        self.page.matches("<img ").count()
    }
}

/// Runs a scene, whose file is called `name`, with these options, and returns what the run printed and wrote.
fn run(name: &str, scene: &str, options: &[&str]) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join(name), folder.path().join("out"));
    fs::write(&file, scene).unwrap();
    let [file, out_name] = [&file, &out].map(|path| path.to_str().unwrap());
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(["run", file, "--out", out_name]).args(options);
    let output = command.env("PALPATE_CACHE", folder.path().join("cache")).output().unwrap();
    assert!(output.status.success(), "palpate run failed: {}", String::from_utf8_lossy(&output.stderr));
    let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    let lines: Vec<String> = String::from_utf8(output.stdout).unwrap().lines().map(Into::into).collect();
    let page_file = Path::new(out_name).join("report.html");
    assert_eq!(lines.last().unwrap(), &format!("report: {}", page_file.display()));
    let mut trace = csv::Reader::from_path(out.join("trace.csv")).unwrap();
    let trace = std::iter::once(trace.headers().unwrap().clone()).chain(trace.records().map(Result::unwrap)).collect();
    Ran { lines, summary: serde_json::from_str(&read("summary.json")).unwrap(), page: read("report.html"), trace }
}

#[test]
fn a_press_is_told_by_the_closing_lines_the_summary_and_the_page() {
    let ran = run("press.toml", &format!("{BLOCK}{PRESS}"), &[]);
    // The numbers of the summary must be those that follow from the trace.
    let column = |name: &str| ran.trace[0].iter().position(|head| head == name).unwrap();
    let numbers = |names: [&str; 3], row: &csv::StringRecord| {
        glam::DVec3::from(names.map(|name| row[column(name)].parse::<f64>().unwrap()))
    };
    let rows: Vec<_> = ran.trace[1..]
        .iter()
        .map(|row| {
            let (force, centre) = (["force_x", "force_y", "force_z"], ["tool_x", "tool_y", "tool_z"]);
            (row[column("time_s")].parse::<f64>().unwrap(), numbers(force, row), numbers(centre, row))
        })
        .collect();
    let touching: Vec<_> = rows.iter().filter(|(_, force, _)| force.length() > 0.0).collect();
    let peak = touching.iter().max_by(|a, b| a.1.length().total_cmp(&b.1.length())).unwrap();
    let depth = (touching[0].2 - peak.2).dot(peak.1.normalize());
    let felt = &ran.summary["felt"];
    let number = |name: &str| felt[name].as_f64().unwrap();
    assert_eq!((&felt["touched"], number("peak_force_n")), (&Value::Bool(true), peak.1.length()));
    assert_eq!((number("first_touch_s"), number("peak_time_s")), (touching[0].0, peak.0));
    assert!((number("indentation_at_peak_m") - depth).abs() < 1e-12 && depth > 1e-3, "felt: {felt}; depth: {depth} m");
    assert_eq!(felt["steps_in_contact"].as_u64(), Some(touching.len() as u64));
    // The page and the first closing line must tell the numbers in words.
    let text = ran.text();
    let expected = [
        format!("The tool felt at most {:.4} N", number("peak_force_n")),
        format!("an indentation of {:.2} mm", 1e3 * number("indentation_at_peak_m")),
        format!("in contact in {} of {} steps.", touching.len(), rows.len()),
    ];
    assert!(expected.iter().all(|part| text.contains(part) && ran.line(0).contains(part)), "wrong page: {text}");
    assert!(
        ran.line(1).starts_with("stage "),
        "no step raised a flag, so the table of stage times must follow: {:?}",
        ran.lines
    );
    let captions =
        ["Force over time.", "Indentation over time.", "Force over indentation.", "Contacts", "Solver iterations"];
    assert!(captions.iter().all(|caption| ran.figures(caption) == 1), "wrong page: {text}");
    for part in [ran.summary["device"].as_str().unwrap(), ran.summary["driver"].as_str().unwrap(), "palpate run "] {
        assert!(text.contains(part), "{part} is not in the page: {text}");
    }
    for (stage, times) in ran.summary["stage_us"].as_object().unwrap() {
        let median = format!("{:.3}", 1e-3 * times["median"].as_f64().unwrap());
        assert!(text.contains(stage) && text.contains(&median), "{stage} or {median} ms is not in the page: {text}");
    }
    if cfg!(feature = "view") {
        assert_eq!(ran.pictures(), 2, "the page must show the whole scene, and the contact");
    } else {
        assert!(text.contains("built without pictures"), "wrong page: {text}");
    }
}

#[test]
fn a_tool_that_never_touched_is_told_with_a_remedy() {
    let away = PRESS.replace("0.021", "0.06").replace("0.01, 0.0]]", "0.05, 0.0]]");
    let ran = run("away.toml", &format!("{BLOCK}{away}"), &["--steps", "1"]);
    let text = ran.text();
    assert_eq!(ran.line(0), "The tool never touched anything.");
    assert!(
        text.starts_with("palpate: away The tool never touched anything. At the end the tool's surface was 3"),
        "wrong page: {text}"
    );
    assert!(
        text.contains("mm from block, the nearest soft body or plane. Let the keys of [drive] lead"),
        "wrong page: {text}"
    );
    assert!(ran.line(1).contains("from block"), "wrong lines: {:?}", ran.lines);
    let felt = &ran.summary["felt"];
    assert_eq!(
        (&felt["touched"], &felt["peak_time_s"], &felt["steps_in_contact"]),
        (&false.into(), &Value::Null, &0.into())
    );
    assert!(
        ran.figures("Force") == 0 && ran.figures("Indentation") == 0 && ran.figures("Contacts") == 1,
        "wrong page: {text}"
    );
    assert!(ran.pictures() <= 1, "without a contact there must be no picture of the contact");
}

#[test]
fn a_scene_without_a_tool_has_contacts_and_its_name_cannot_be_markup() {
    let other = BLOCK.split("[[body.core]]").next().unwrap().replace("\"block\"", "\"stone\"");
    let other =
        other.replace("[-0.05, -0.05, -0.05], [0.05, 0.0, 0.05]", "[-0.02, -0.0005, -0.02], [0.02, 0.03, 0.02]");
    let ran = run("<script>alert(1)&.toml", &format!("{BLOCK}{other}"), &["--steps", "20"]);
    let text = ran.text();
    assert!(
        ran.line(0).starts_with("The scene has no tool, so no force was felt; its bodies had up to "),
        "wrong page: {text}"
    );
    assert!(text.starts_with(&format!("palpate: <script>alert(1)& {}", ran.line(0))), "wrong page: {text}");
    assert!(
        ran.figures("Force") == 0 && ran.figures("Contacts") == 1 && ran.summary["felt"] == Value::Null,
        "wrong page: {text}"
    );
    assert!(
        text.contains("'") && !ran.page.contains("<script"),
        "the scene's name must be quoted in the command, and must not become markup: {text}"
    );
}

#[test]
fn flags_come_first_and_a_held_body_is_a_tool() {
    // One iteration is too few for the solver, so it does not converge and the flag for this is raised.
    let pad = "[solver]\nmax_iterations = 1\n[[body]]\nname = \"pad\"\nposition = [0.0, 0.0195, 0.0]\n\
        layer = { box = [[-0.02, -0.02, -0.02], [0.02, 0.02, 0.02]], cells = [4, 4, 4] }\n\
        material = { young = 2e4, poisson = 0.45, density = 1000.0 }\n\
        [[body.core]]\nname = \"grip\"\nmotion = \"dynamic\"\n\
        bind = { box = [[-0.011, -0.011, -0.011], [0.011, 0.011, 0.011]] }\n[tool]\nbody = \"pad\"\n\
        [coupling]\nstiffness = 500.0\ndamping = 5.0\n";
    let ran = run("held.toml", &format!("{BLOCK}{pad}"), &["--steps", "12"]);
    let text = ran.text();
    let count = ran.summary["flags"]["not_converged"].as_u64().unwrap();
    assert!(count > 0 && ran.summary["felt"]["touched"] == true, "wrong summary: {}", ran.summary);
    let title =
        format!("palpate: held What went wrong The solver did not converge , in {count} of 12 steps. The residual");
    assert!(text.starts_with(&title) && text.contains("Remedy: Raise solver.max_iterations"), "wrong page: {text}");
    assert!(ran.line(0).starts_with("The tool felt at most "), "wrong lines: {:?}", ran.lines);
    let warned = format!("warning: the solver did not converge, in {count} of 12 steps. ");
    let at = ran.lines.iter().position(|line| line.starts_with(&warned)).unwrap();
    assert!(at < ran.lines.iter().position(|line| line.starts_with("stage ")).unwrap(), "wrong lines: {:?}", ran.lines);
    let section = ran.page.find("<section class=\"flags\">").unwrap();
    assert!(section < ran.page.find("The tool felt at most").unwrap());
}

#[test]
fn a_session_has_its_device_energy_lateness_and_events_on_the_page() {
    let ran = run("session.toml", &format!("{BLOCK}{PRESS}"), &["--haptics", "scripted", "--seconds", "0.6"]);
    let (text, haptics) = (ran.text(), &ran.summary["haptics"]);
    assert_eq!(ran.figures("Force played over time"), 1, "wrong page: {text}");
    let played = format!("The greatest force played was {:.4} N", haptics["peak_force_n"].as_f64().unwrap());
    let worst = format!("{:.0}", haptics["lateness"]["worst_us"].as_f64().unwrap());
    let lent = format!("{:.3}", 1e3 * haptics["energy_j"]["lent"].as_f64().unwrap());
    // Lent energy is what the hand receives before it has given as much; the page calls it "received in advance".
    for part in [&played, &worst, &lent, "haptic loop", "a thread that only sleeps", "received in advance"] {
        assert!(text.contains(part), "{part} is not in the page: {text}");
    }
    // The force fades in at the start of every session (run with a haptic device).
    assert!(
        haptics["events"]["engaging"].is_object() && text.contains("The force was fading in"),
        "wrong page: {text}"
    );
    assert!(text.contains("from 0.001 s to 0.02 s") && !text.contains("late_tick"), "wrong page: {text}");
    let events = ran.lines.iter().find(|line| line.starts_with("events: ")).unwrap();
    assert!(events.contains("the force was fading in: "), "wrong events: {events}");
}

#[test]
fn without_a_folder_the_last_line_tells_of_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("press.toml");
    fs::write(&file, format!("{BLOCK}{PRESS}")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    let output = command.args(["run", file.to_str().unwrap(), "--steps", "1"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.lines().last().unwrap().contains("give --out DIR"), "wrong output: {text}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing may be written");
}
