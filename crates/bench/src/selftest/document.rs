//! The page of a self-test.

use super::{Results, TOLERANCE, greatest};
use crate::{Chapter, Document, Section, Table};

/// The results as a document.
pub fn document(results: &Results) -> Document {
    let faults = results.faults();
    let verdict = match faults.as_slice() {
        [] => "All agree.".to_string(),
        faults => format!("{}.", faults.join("; ")),
    };
    let preface = format!(
        "{} ({}), workgroups of {}; palpate {}.",
        results.device,
        results.driver,
        results.workgroup,
        env!("CARGO_PKG_VERSION")
    );
    let sections = vec![costs(results), scenes(results), choices(results)];
    let chapter = Chapter { title: verdict, preface: String::new(), sections };
    Document { title: "Self-test".into(), preface, chapters: vec![chapter] }
}

fn costs(results: &Results) -> Section {
    let rows = results.costs.iter().map(|cost| vec![cost.what.to_string(), format!("{:.2}", cost.us)]).collect();
    let submit = results.costs.first().map_or(0.0, |cost| cost.us);
    Section {
        title: "What the device costs".into(),
        question: "What does a step cost before it computes anything?".into(),
        table: Table { rows, ..Table::new(["what", "us"]) },
        finding: format!("a step, which is one submit where nothing is repeated, takes {submit:.0} us at least."),
        ..Section::default()
    }
}

fn scenes(results: &Results) -> Section {
    let row = |scene: &super::Agreement| {
        let (size, unit) = if scene.is_force { (scene.greatest, "N") } else { (1e3 * scene.greatest, "mm") };
        vec![
            scene.scene.clone(),
            format!("{size:.4} {unit}"),
            format!("{:.1e}", scene.difference),
            format!("{:.1}", scene.iterations),
            format!("{:.2}", scene.step_ms),
            scene.flags.join(", "),
        ]
    };
    let worst = greatest(results.scenes.iter().map(|scene| scene.difference));
    Section {
        title: "Shipped scenes".into(),
        question: "Do the shipped scenes give the forces, or without a tool the displacements, that are pinned? Their \
                   first 60 steps (of held-pad 260), solved to 1e-6, so that a step takes longer than with the \
                   scene's own settings."
            .into(),
        table: Table {
            rows: results.scenes.iter().map(row).collect(),
            ..Table::new(["scene", "greatest", "difference", "iterations a step", "ms a step", "flags"])
        },
        finding: format!("the greatest difference is {worst:.1e} of the greatest value; {TOLERANCE:.0e} is allowed."),
        ..Section::default()
    }
}

fn choices(results: &Results) -> Section {
    let row = |variant: &super::Variant| vec![variant.choice.clone(), format!("{:.1e}", variant.difference)];
    let worst = greatest(results.variants.iter().map(|variant| variant.difference));
    let (steps, same) = results.repeats;
    Section {
        title: "Choices that must not matter".into(),
        question: "Does a small scene give the same forces with each of these choices?".into(),
        table: Table {
            rows: results.variants.iter().map(row).collect(),
            ..Table::new(["choice", "difference, of the greatest force"])
        },
        finding: format!(
            "the greatest difference is {worst:.1e}; {TOLERANCE:.0e} is allowed. {steps} steps, done twice, gave {}.",
            if same { "the same bits" } else { "other bits" }
        ),
        ..Section::default()
    }
}
