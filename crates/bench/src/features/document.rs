//! The report of what each feature of the engine costs in time and memory ([`super::Cost`]), by scenes with the feature
//! and without it.

use palpate::Result;

use super::{Cost, Feature, Run};
use crate::plot::{self, Bar};
use crate::{Section, Table};

/// The section of the report: for each feature a row of the table and two bars of the plot (with and without the
/// feature); and the finding in words.
pub fn section(costs: &[(Feature, Cost)]) -> Result<Section> {
    let heads = [
        "feature",
        "what is compared",
        "with, ms",
        "without, ms",
        "ratio",
        "iterations",
        "ratio per iteration",
        "with, MB",
        "without, MB",
        "passes",
        "dependent passes",
        "when not used",
    ];
    let mut table = Table::new(heads);
    let mut bars = Vec::new();
    for (feature, cost) in costs {
        let Cost { with, without, .. } = cost;
        let pair = |of: fn(&Run) -> u32| format!("{} / {}", of(with), of(without));
        let megabytes = |run: &Run| format!("{:.2}", 1e-6 * run.plan.bytes_device as f64);
        table.rows.push(vec![
            feature.name().into(),
            feature.question().into(),
            format!("{:.2}", with.ms()),
            format!("{:.2}", without.ms()),
            format!("{:.2}", with.ms() / without.ms()),
            format!("{:.0} / {:.0}", with.mean_iterations(), without.mean_iterations()),
            format!("{:.2}", with.ms_an_iteration() / without.ms_an_iteration()),
            megabytes(with),
            megabytes(without),
            pair(|run| run.plan.passes),
            pair(|run| run.plan.dependent_passes),
            match cost.is_free_when_idle() {
                Some(true) => "identical".into(),
                Some(false) => "NOT identical".into(),
                None => "-".into(),
            },
        ]);
        for (run, kind, what) in [(with, 0, "with"), (without, 1, "without")] {
            bars.push(Bar { name: format!("{what} {}", feature.name()), length: run.ms(), kind });
        }
    }
    Ok(Section {
        title: "Time and memory of a step with each feature, and without it".into(),
        question:
            "What does a feature cost where it is used, and where it is not? Iterations (mean of a step), passes \
             (kernels, fills and copies on the GPU) and dependent passes (those that wait for an earlier pass) are \
             given with the feature / without it. The ratio per iteration leaves out that a feature may make systems \
             harder to solve. `when not used` compares a simulation in which the feature is switched off with one \
             whose scene does not mention it: are their passes, arrays and bytes identical? Friction and damping are \
             switched off by zero; the coarse level by the Jacobi preconditioner, on a body so soft that the engine \
             chooses no other; stiffness and timestamps by no longer asking for them. `-`: no key of a scene switches \
             the feature off."
                .into(),
        table,
        plot: Some(plot::bars("ms a step", &bars)?),
        finding: finding(costs),
        notes: vec![format!("Kernels and memory that each feature adds to a step: {}.", beyond(costs))],
    })
}

fn beyond(costs: &[(Feature, Cost)]) -> String {
    let one = |(feature, cost): &(Feature, Cost)| {
        format!("{}: {}", feature.name(), cost.with.plan.beyond(&cost.without.plan))
    };
    costs.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// The features that cost most in time and in memory, and whether each feature that is switched off costs nothing.
fn finding(costs: &[(Feature, Cost)]) -> String {
    let time = |cost: &Cost| cost.with.ms() / cost.without.ms();
    let bytes = |cost: &Cost| cost.with.plan.bytes_device as f64 / cost.without.plan.bytes_device.max(1) as f64;
    let most = |of: &dyn Fn(&Cost) -> f64| costs.iter().max_by(|a, b| of(&a.1).total_cmp(&of(&b.1)));
    let (Some((slow, a)), Some((large, b))) = (most(&time), most(&bytes)) else { return String::new() };
    let (mut free, mut not) = (0, Vec::new());
    for (feature, cost) in costs {
        match cost.is_free_when_idle() {
            Some(true) => free += 1,
            Some(false) => not.push(feature.name()),
            None => (),
        }
    }
    let idle = match not.as_slice() {
        [] => format!("all {free} features that can be switched off cost nothing when they are"),
        not => format!("NOT free when switched off: {}", not.join(", ")),
    };
    format!(
        "The feature that costs most time is {} ({:.2} times the step without it), that which costs most memory {} \
         ({:.2} times); {idle}.",
        slow.name(),
        time(a),
        large.name(),
        bytes(b)
    )
}
