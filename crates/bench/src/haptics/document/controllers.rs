//! The section of the haptics report that compares passivity controllers, which keep the hand from receiving more
//! energy than it gave.

use palpate::Result;

use super::range;
use crate::haptics::controllers::SPEED;
use crate::haptics::{Controlled, Controller};
use crate::{Section, Table};

/// A controller counts as keeping a steady force if the force differs by at most this share from the force that the
/// body and the virtual coupling (spring and damper between the haptic device and the simulation) would exert as
/// springs in equilibrium.
const WITHIN: f64 = 0.03;

/// The section with a table of all cases: the share of a steady force that each controller leaves, and the energy that
/// the hand gains.
pub fn controllers(all: &[Controlled]) -> Result<Section> {
    let heads = [
        "controller",
        "device",
        "body, N/m",
        "rate, Hz",
        "gap known",
        "force played, %",
        "noise, mN",
        "controller acts, % of ticks",
        "net energy to the hand, mJ",
        "most energy lent, mJ",
    ];
    let mut table = Table::new(heads);
    for case in all {
        let name = Controller::ALL.iter().find(|(own, _)| *own == case.controller).map_or("", |(_, name)| name);
        table.rows.push(vec![
            name.into(),
            case.profile.clone(),
            format!("{:.0}", case.body),
            format!("{:.0}", case.rate),
            if case.gap { "yes" } else { "no" }.into(),
            format!("{:.1}", 1e2 * case.share),
            format!("{:.1}", 1e3 * case.deviation),
            format!("{:.1}", 1e2 * case.acts),
            format!("{:.2}", 1e3 * case.net),
            format!("{:.2}", 1e3 * case.lent),
        ]);
    }
    Ok(Section {
        title: "Passivity controllers compared".into(),
        question: format!(
            "How much of a steady force does a controller leave, and how much energy does the hand gain? A hand \
             presses a soft body with one degree of freedom at {:.0} mm/s, holds it for three seconds and releases it. \
             `force played`: mean over the last second of the hold, relative to the springs' force in equilibrium at \
             the device's position. `net energy to the hand`: force times displacement by the device's readings, over \
             the whole press; it includes energy that was lent and is not repaid by the end. The controller of \
             Hannaford and Ryu, and reference energy following (whose reference is the energy stored in coupling and \
             contact model), act on the force of a session without a controller of its own, and inject at most the \
             device's published damping.",
            1e3 * SPEED
        ),
        table,
        finding: finding(all),
        ..Section::default()
    })
}

fn finding(all: &[Controlled]) -> String {
    let told = Controller::ALL.into_iter().filter_map(|(controller, name)| {
        let own: Vec<&Controlled> = all.iter().filter(|case| case.controller == controller).collect();
        let there = own.iter().filter(|case| (case.share - 1.0).abs() <= WITHIN).count();
        let gain = own.iter().map(|case| 1e3 * (case.net - case.lent).max(0.0)).fold(0.0, f64::max);
        (!own.is_empty()).then(|| {
            let shares = range(own.iter().map(|case| 1e2 * case.share), |share| format!("{share:.0}"));
            format!("{name} {shares} % ({there} of {} cases within 3 %), {gain:.2} mJ", own.len())
        })
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() {
        return "nothing was measured.".into();
    }
    format!(
        "Share of a steady force that is played, and most energy that the hand gains beyond what it was lent: {}.",
        told.join("; ")
    )
}
