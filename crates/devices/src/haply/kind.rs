//! Types of Haply's haptic devices as Haply's Inverse service (a program on the same machine, see `mod.rs`) reports
//! them, and the profile (limits of force, workspace and so on) that each type gets. The profile follows from the
//! reported type and not from the user's word, because an Inverse3 may exert several times the force of a Minverse.

use std::fmt;
use std::sync::Arc;

use palpate::scene::profile::{HAPLY_SMALLEST, INVERSE3, MINVERSE, Profile};
use serde_json::Value;

/// The types that the service reports under the key `config.type` in its inventory (list of devices), as Haply's own
/// client library names them (crate `haply` 1.3, `device_model/enums.rs`), and their profiles. Haply publishes no
/// separate limits for the Inverse3x; its tutorials use the same limits for the Inverse3x as for the Inverse3
/// (docs.haply.co, Inverse service 3.5, tutorial 06).
const KNOWN: [(&str, &Profile); 3] = [("inverse3", &INVERSE3), ("inverse3x", &INVERSE3), ("minverse", &MINVERSE)];
/// Greatest length of a type's name in messages to the user, characters; longer names are cut off.
const LONGEST: usize = 40;

/// A device type as the service reports it; it may report none.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Kind(Option<Arc<str>>);

/// Identity of a device that the service lists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Id by which messages to the service name the device.
    pub device_id: String,
    pub kind: Kind,
}

impl Kind {
    /// Reads the type from `config`, an entry that a device has in the inventory, the first message of a connection.
    pub fn of_config(config: Option<&Value>) -> Kind {
        let told = config.and_then(|config| config.get("type")).filter(|told| !told.is_null());
        let text = |told: &Value| told.as_str().map_or_else(|| told.to_string(), String::from);
        Kind(told.map(|told| text(told).chars().take(LONGEST).collect::<String>().into()))
    }

    fn known(&self) -> Option<&'static Profile> {
        let name = self.0.as_deref()?;
        KNOWN.iter().find(|(known, _)| *known == name).map(|(_, profile)| *profile)
    }

    /// The profile used for a device of this type: the type's own, or the Haply profile with the lowest limits where
    /// the type is not known. The profile `asked`, which the user asks for, is used instead only if it is that of a
    /// Haply device and none of its limits is higher.
    pub fn profile(&self, asked: Option<&'static Profile>) -> &'static Profile {
        let own = self.known().unwrap_or(&HAPLY_SMALLEST);
        asked.filter(|asked| asked.is_haplys() && asked.is_within(own)).unwrap_or(own)
    }

    /// Notes for the user on the profile that is used, each of one line.
    pub fn notes(&self, asked: Option<&'static Profile>) -> Vec<String> {
        let granted = self.profile(asked);
        let mut notes = Vec::new();
        if self.known().is_none() {
            notes.push(format!(
                "the Inverse service reports {self}, for which palpate knows no limits: the profile {} with the lowest \
                 limits of Haply's devices is used (greatest force {} N, workspace radius {} m)",
                granted.name, granted.max_force, granted.workspace
            ));
        }
        if let Some(asked) = asked.filter(|asked| asked.name != granted.name) {
            let why = if asked.is_haplys() { "exceeds the limits of the device" } else { "is not that of a Haply" };
            notes.push(format!("the profile {} {why}: the profile {} is used", asked.name, granted.name));
        }
        notes
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match &self.0 {
            // The name is quoted with control characters escaped, because it comes from another program.
            Some(name) => write!(f, "the device type {name:?}"),
            None => write!(f, "no device type"),
        }
    }
}

#[cfg(test)]
mod tests {
    use palpate::scene::profile::{HAPLY, PROFILES};
    use serde_json::json;

    use super::*;

    fn kind(told: Value) -> Kind {
        Kind::of_config(Some(&json!({ "type": told })))
    }

    #[test]
    fn the_reported_type_decides_and_an_unknown_one_gets_the_smallest() {
        for (told, profile) in [("inverse3", "inverse3"), ("inverse3x", "inverse3"), ("minverse", "minverse")] {
            let kind = kind(json!(told));
            assert_eq!((kind.profile(None).name, kind.notes(None)), (profile, vec![]), "reported type {told}");
        }
        let others =
            [json!("maxverse"), json!("Inverse3"), json!(""), json!(4), json!({"name": "inverse3"}), json!("\n")];
        for told in others {
            let kind = kind(told.clone());
            assert_eq!(kind.profile(None), &HAPLY_SMALLEST, "reported type {told}");
            let notes = kind.notes(None);
            assert!(
                notes.len() == 1 && notes[0].contains("2 N, workspace radius 0.04 m") && !notes[0].contains('\n'),
                "wrong notes: {notes:?}"
            );
        }
        for none in [None, Some(json!({})), Some(json!({"type": null})), Some(json!(7))] {
            let kind = Kind::of_config(none.as_ref());
            assert_eq!(kind.profile(None), &HAPLY_SMALLEST);
            assert!(kind.notes(None)[0].contains("reports no device type"), "wrong notes: {:?}", kind.notes(None));
        }
        let long = kind(json!("x".repeat(1000))).notes(None);
        assert!(long[0].len() < 300, "the note is too long: {long:?}");
    }

    #[test]
    fn a_profile_that_is_asked_for_lowers_and_never_raises() {
        for told in ["inverse3", "inverse3x", "minverse", "maxverse"] {
            let kind = kind(json!(told));
            let own = kind.profile(None);
            for asked in PROFILES.each_ref().map(|profile| Profile::named(profile.name)) {
                let (granted, name) = (kind.profile(asked), asked.unwrap().name);
                assert!(
                    granted.is_within(own) && HAPLY.contains(granted),
                    "type {told}, requested profile {name}, granted {granted:?}"
                );
                assert_eq!(
                    granted.name == name,
                    !kind.notes(asked).iter().any(|note| note.contains(name) && !note.contains("reports")),
                    "type {told}, requested profile {name}"
                );
            }
        }
        let (large, small) = (kind(json!("inverse3")), kind(json!("minverse")));
        assert_eq!(large.profile(Some(&MINVERSE)).name, "minverse");
        assert_eq!(small.profile(Some(&INVERSE3)).name, "minverse");
        assert!(small.notes(Some(&INVERSE3))[0].contains("profile inverse3 exceeds"));
        assert!(large.notes(Profile::named("touch"))[0].contains("profile touch is not that of a Haply"));
    }
}
