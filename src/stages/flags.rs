//! Flags of a step: what went wrong in it. This is the one place that gives each flag its bit, its name, and the words
//! in which programs tell a user of it.

use crate::shaders;

/// What a flag of a step, or an event of the haptic loop, tells a user. Title and sentences are plain text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Explanation {
    /// A few words, in lower case, such as "the solver did not converge".
    pub title: &'static str,
    /// What happened, and what follows for the results.
    pub meaning: &'static str,
    /// What the user can change; `None`: nothing needs to be changed.
    pub remedy: Option<&'static str>,
}

/// A set of flags. The bits are those of the `flags` column of `trace.csv`, and of the shaders, which define the bits
/// of the flags that they raise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Flags(pub u32);

impl Flags {
    /// The residual at the end of the solve is above ten times the solver's tolerance, and above ten times what single
    /// precision can reach.
    pub const NOT_CONVERGED: Flags = Flags(shaders::FLAG_NOT_CONVERGED);
    /// There are more contact patches (places where a pair of bodies may touch, each with a normal), or more work items
    /// (a work item is a group of skin vertices in one contact patch), than there is room for; or the scene's
    /// `contact.texel` is too small for the size of a patch.
    pub const PATCH_OVERFLOW: Flags = Flags(shaders::FLAG_PATCH_OVERFLOW);
    /// There are more contacts, or more ray hits (points where a vertex's ray along a patch's normal meets a triangle),
    /// than there is room for.
    pub const CONTACT_OVERFLOW: Flags = Flags(shaders::FLAG_CONTACT_OVERFLOW);
    /// A contact is deeper than the scene's `depth_limit`.
    pub const DEPTH_BEYOND_LIMIT: Flags = Flags(shaders::FLAG_DEPTH_LIMIT);
    /// A skin (surface mesh) is folded over itself in the direction of a contact patch's normal.
    pub const NOT_A_HEIGHT_FIELD: Flags = Flags(shaders::FLAG_NOT_HEIGHT_FIELD);
    /// A number in the solve was not finite, so the step was not accepted: it was repeated (`STEP_RETRIED`) or given up
    /// (`FROZEN`).
    pub const NON_FINITE: Flags = Flags(shaders::FLAG_NON_FINITE);
    /// The step was repeated with a smaller time step.
    pub const STEP_RETRIED: Flags = Flags(64);
    /// No attempt at the step succeeded, however short its time step: the bodies were stopped where they are.
    pub const FROZEN: Flags = Flags(128);
    /// Contacts under tension were released (left without stiffness), but after the last release others are still under
    /// tension.
    pub const TENSION_REMAINS: Flags = Flags(shaders::FLAG_TENSION);
    /// A rigid coordinate frame turned so far within the step that its nodes may gain energy, since their elements keep
    /// the rotations of the start of the step.
    pub const TURNS_TOO_FAR: Flags = Flags(512);
    /// A tetrahedron was inverted at the displacements about which the step was linearised, or it was pressed so flat
    /// that its rotation was not found.
    pub const INVERTED: Flags = Flags(shaders::FLAG_INVERTED);
    /// After the last of several Newton iterations the residual of the step's nonlinear equations is above half of what
    /// it was before the first, and above ten times what single precision can reach.
    pub const NEWTON_NOT_CONVERGED: Flags = Flags(shaders::FLAG_NEWTON_NOT_CONVERGED);

    /// The tool moved further than its own extent in a step, or in each of the parts of a step, so that it may have passed
    /// through a body.
    pub const MOVED_TOO_FAR: Flags = Flags(4096);

    /// Every flag and its name, by rising bit.
    pub const ALL: [(Flags, &'static str); 13] = [
        (Flags::NOT_CONVERGED, "not_converged"),
        (Flags::PATCH_OVERFLOW, "region_overflow"),
        (Flags::CONTACT_OVERFLOW, "contact_overflow"),
        (Flags::DEPTH_BEYOND_LIMIT, "depth_beyond_limit"),
        (Flags::NOT_A_HEIGHT_FIELD, "not_a_height_field"),
        (Flags::NON_FINITE, "non_finite"),
        (Flags::STEP_RETRIED, "step_retried"),
        (Flags::FROZEN, "frozen"),
        (Flags::TENSION_REMAINS, "adhesive_dropped_twice"),
        (Flags::TURNS_TOO_FAR, "turns_too_far"),
        (Flags::INVERTED, "inverted"),
        (Flags::NEWTON_NOT_CONVERGED, "newton_not_converged"),
        (Flags::MOVED_TOO_FAR, "moved_too_far"),
    ];

    /// The words for each flag, in the order of [`Flags::ALL`].
    const EXPLANATIONS: [Explanation; Flags::ALL.len()] = [
        Explanation {
            title: "the solver did not converge",
            meaning: "The residual of the linear system, or the error of the contact forces, stayed above ten times what \
                      the solver's tolerance allows, so the forces and displacements of these steps are less exact \
                      than was requested.",
            remedy: Some(
                "Raise solver.max_iterations, shorten step.dt, or make the stiffest and the softest material differ less.",
            ),
        },
        Explanation {
            title: "too many contact patches",
            meaning: "Two bodies touch in more directions than the four contact patches of a pair can represent, or more \
                      skin is near contact than there is room for, so some contacts are missing.",
            remedy: Some("Set contact.texel to \"auto\", give coarser skins, or press on a smaller or smoother area."),
        },
        Explanation {
            title: "too many contacts",
            meaning: "More than 32,768 contacts were found, of which the deepest are kept, or more rays met triangles, or \
                      more triangles overlapped, than there is room for. Which of them are kept may differ from run to \
                      run.",
            remedy: Some("Give coarser skins, set contact.sides to \"one\", or press on a smaller area."),
        },
        Explanation {
            title: "a contact is deeper than the limit",
            meaning: "Skin lies deeper inside another body than contact.depth_limit. Some vertices as deep as that are \
                      left out, so the force may be wrong.",
            remedy: Some(
                "Raise contact.stiffness or contact.depth_limit, shorten step.dt, or move the bodies more slowly.",
            ),
        },
        Explanation {
            title: "a skin folds over itself where it is touched",
            meaning: "Seen along the direction of contact, a skin covers itself, or a body went through a thin sheet. The \
                      depth of contact is ambiguous there, and the force may be wrong.",
            remedy: Some("Press less deep, away from folds and thin sheets, or shorten step.dt."),
        },
        Explanation {
            title: "a number was not finite",
            meaning: "The solution of the step contained a number that is not finite. The solution was rejected, and the \
                      step was repeated in shorter steps or given up.",
            remedy: Some("Shorten step.dt, and give less extreme sizes, masses and stiffnesses."),
        },
        Explanation {
            title: "the step was repeated in shorter steps",
            meaning: "The step failed and was done in two, four or eight shorter steps instead.",
            remedy: Some("Shorten step.dt, or move the bodies more slowly."),
        },
        Explanation {
            title: "the simulation stood still",
            meaning: "The step failed however short it was made, so everything that moves by itself was stopped where it \
                      is. The results of these steps are not physical.",
            remedy: Some("Shorten step.dt, and give less extreme masses, stiffnesses and speeds."),
        },
        Explanation {
            title: "some contacts pull",
            meaning: "Contacts that would pull bodies together are released, and the solver goes on without them. After \
                      the last release some contacts still pull, so the force may be a little too small.",
            remedy: Some("Shorten step.dt, or lower contact.damping."),
        },
        Explanation {
            title: "a body turns too far in a step",
            meaning: "Rotations are kept constant over a step. A body or a core turned so far within one step that it may \
                      gain energy.",
            remedy: Some("Shorten step.dt, or set step.newton to 2."),
        },
        Explanation {
            title: "a tetrahedron is inside out",
            meaning: "A tetrahedron was inverted, or pressed so flat that its rotation was not found, so the elastic force \
                      there is not that of the material.",
            remedy: Some("Press less deep, shorten step.dt, or give larger cells or a stiffer material."),
        },
        Explanation {
            title: "the Newton iterations did not converge",
            meaning: "After all Newton iterations of the step its equations were not solved: the next linearisation would \
                      move the bodies about as far again. Shapes and forces of these steps may be wrong.",
            remedy: Some("Shorten step.dt, or set step.newton to 1 and compare."),
        },
        Explanation {
            title: "the tool moved too far in a step",
            meaning: "Contact is looked for once a step. Near a body the tool moved further than its own extent, in one of \
                      the parts into which fast steps are divided or between two steps of a haptic loop, so it may \
                      have passed through the body.",
            remedy: Some("Shorten step.dt, or move the tool more slowly."),
        },
    ];

    /// Each flag in this set with the words that explain it to a user, by rising bit.
    pub fn explained(self) -> impl Iterator<Item = (Flags, &'static Explanation)> {
        let all = Flags::ALL.iter().zip(&Flags::EXPLANATIONS);
        all.filter(move |((flag, _), _)| self.contains(*flag)).map(|((flag, _), words)| (*flag, words))
    }

    /// Whether all flags of `other` are in this set.
    pub fn contains(self, other: Flags) -> bool {
        self.0 & other.0 == other.0
    }

    /// Names of the flags in this set, by rising bit.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Flags::ALL.into_iter().filter(move |(flag, _)| self.contains(*flag)).map(|(_, name)| name)
    }
}

impl std::ops::BitOr for Flags {
    type Output = Flags;

    fn bitor(self, other: Flags) -> Flags {
        Flags(self.0 | other.0)
    }
}

impl std::ops::BitOrAssign for Flags {
    fn bitor_assign(&mut self, other: Flags) {
        self.0 |= other.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_the_design_and_names_follow_them() {
        let bits: Vec<u32> = Flags::ALL.iter().map(|(flag, _)| flag.0).collect();
        assert_eq!(bits, [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096]);
        let set = Flags::FROZEN | Flags::NOT_CONVERGED;
        assert_eq!(set.names().collect::<Vec<_>>(), ["not_converged", "frozen"]);
        assert!(set.contains(Flags::FROZEN) && !set.contains(Flags::NON_FINITE));
    }

    #[test]
    fn every_flag_is_explained_and_no_two_alike() {
        let all = Flags::ALL.into_iter().fold(Flags::default(), |all, (flag, _)| all | flag);
        let words: Vec<_> = all.explained().collect();
        let titles: std::collections::BTreeSet<_> = words.iter().map(|(_, words)| words.title).collect();
        assert_eq!((words.len(), titles.len()), (Flags::ALL.len(), Flags::ALL.len()));
        for (_, Explanation { title, meaning, remedy }) in words {
            assert!(!title.is_empty() && !title.ends_with('.'), "title \"{title}\" is empty or ends with a full stop");
            assert!(
                meaning.ends_with('.') && remedy.is_some_and(|remedy| remedy.ends_with('.')),
                "the meaning or the remedy of the flag titled \"{title}\" does not end with a full stop"
            );
        }
        let frozen: Vec<_> =
            (Flags::FROZEN | Flags::NOT_CONVERGED).explained().map(|(flag, w)| (flag, w.title)).collect();
        let expected =
            [(Flags::NOT_CONVERGED, "the solver did not converge"), (Flags::FROZEN, "the simulation stood still")];
        assert_eq!(frozen, expected);
    }
}
