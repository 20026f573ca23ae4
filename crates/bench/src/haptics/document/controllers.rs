//! The section of the report that compares passivity controllers.

use palpate::Result;

use super::range;
use crate::haptics::controllers::SPEED;
use crate::haptics::{Controlled, Controller};
use crate::{Section, Table};

/// A force counts as there if it differs from that of the springs in equilibrium by at most this share.
const WITHIN: f64 = 0.03;

/// The section: what each controller leaves of a steady force, and the energy that the hand gains.
pub fn controllers(all: &[Controlled]) -> Result<Section> {
    let heads = [
        "controller",
        "device",
        "body, N/m",
        "rate, Hz",
        "gap known",
        "played, %",
        "noise, mN",
        "acts, % of ticks",
        "net to the hand, mJ",
        "lent at most, mJ",
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
        title: "Passivity controllers side by side".into(),
        question: format!(
            "What does a controller leave of a steady force, and what does the hand gain? A hand presses a soft body of one \
             coordinate at {:.0} mm/s, holds it for three seconds and lets go. Played: over the last second of the hold, of what \
             springs at rest give at the device's place. Net: force times way by the readings, over all of it; what was lent is \
             paid back by the end or is part of it. Hannaford and Ryu's controller, and reference energy following with \
             what coupling and contact model store as the reference, act on the played force of a session without one, with \
             the device's published damping at most.",
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
            format!("{name} {shares} % ({there} of {} within 3 %), {gain:.2} mJ", own.len())
        })
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() {
        return "nothing was measured.".into();
    }
    format!("of a steady force is played, and the hand gains unlent at most: {}.", told.join("; "))
}
