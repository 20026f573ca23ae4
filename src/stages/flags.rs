//! Flags of a step: what went wrong in it. This is the one place that gives each flag its bit and its name.

use crate::shaders;

/// A set of flags. The bits are those of the `flags` column of `trace.csv`, and of the shaders, which define the bits
/// of the flags that they raise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Flags(pub u32);

impl Flags {
    /// The residual at the end of the solve is above ten times the solver's tolerance, and above ten times what single
    /// precision can reach.
    pub const NOT_CONVERGED: Flags = Flags(shaders::FLAG_NOT_CONVERGED);
    /// There are more contact patches (areas with one normal where two bodies may touch), or more work items (a group
    /// of skin vertices in one contact patch), than there is room for; or the scene's `contact.texel`, the size of a
    /// cell of a patch, is too small for the size of the patch.
    pub const PATCH_OVERFLOW: Flags = Flags(shaders::FLAG_PATCH_OVERFLOW);
    /// There are more contacts, or more ray hits, than there is room for.
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
    /// Contacts under tension were released (left without stiffness), but after the last repeated solve others are
    /// still under tension.
    pub const TENSION_REMAINS: Flags = Flags(shaders::FLAG_TENSION);
    /// A rigid coordinate frame turned so far within the step that its nodes may gain energy, since their elements keep
    /// the rotations of the start of the step.
    pub const TURNS_TOO_FAR: Flags = Flags(512);
    /// A tetrahedron was inverted where the step was linearised, or pressed so flat that its rotation was not found.
    pub const INVERTED: Flags = Flags(shaders::FLAG_INVERTED);

    /// Every flag and its name, by rising bit.
    pub const ALL: [(Flags, &'static str); 11] = [
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
    ];

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
        assert_eq!(bits, [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024]);
        let set = Flags::FROZEN | Flags::NOT_CONVERGED;
        assert_eq!(set.names().collect::<Vec<_>>(), ["not_converged", "frozen"]);
        assert!(set.contains(Flags::FROZEN) && !set.contains(Flags::NON_FINITE));
    }
}
