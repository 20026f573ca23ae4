//! Groups of tetrahedra in a mesh file. A material region (a part of a soft body with its own material) may be given as
//! such a group. Each file format has its own name for groups; Gmsh calls them physical groups.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::Group;

/// Greatest number of groups that an error lists.
const MOST_LISTED: usize = 20;

/// The group that each tetrahedron is in.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Groups {
    /// Number of each tetrahedron's group; `None`: the tetrahedron is in no group. A generated mesh has an empty list.
    pub of: Vec<Option<i64>>,
    /// Names of the groups, by number; a group may have no name.
    pub names: BTreeMap<i64, String>,
}

impl Groups {
    /// Finds `group` among the groups that have tetrahedra, and returns its number. If it is not among these groups,
    /// the error is the remedy to report, which lists these groups.
    pub fn find(&self, group: &Group) -> Result<i64, String> {
        let there: BTreeSet<i64> = self.of.iter().copied().flatten().collect();
        let is_it = |number: &&i64| match group {
            Group::Number(wanted) => wanted == *number,
            Group::Name(wanted) => self.names.get(*number) == Some(wanted),
        };
        there.iter().find(is_it).copied().ok_or_else(|| self.list(&there))
    }

    /// The remedy that lists the groups `there`.
    fn list(&self, there: &BTreeSet<i64>) -> String {
        let name = |number: &i64| match self.names.get(number) {
            Some(name) => format!("{number} \"{}\"", name.escape_debug()),
            None => number.to_string(),
        };
        match there.len() {
            0 => "the file's tetrahedra are in no groups".into(),
            count => {
                let listed: Vec<String> = there.iter().take(MOST_LISTED).map(name).collect();
                let more = count.saturating_sub(MOST_LISTED);
                let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
                format!("the file's groups are {}{rest}", listed.join(", "))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_found_by_name_or_number_and_listed_where_they_are_not() {
        let names = [(3, "fat".into()), (7, "empty".into())].into();
        let groups = Groups { of: vec![Some(3), None, Some(-1), Some(3)], names };
        assert_eq!(groups.find(&Group::Name("fat".into())), Ok(3));
        assert_eq!(groups.find(&Group::Number(-1)), Ok(-1));
        let listed = Err("the file's groups are -1, 3 \"fat\"".to_string());
        for absent in [Group::Name("empty".into()), Group::Name("3".into()), Group::Number(7)] {
            assert_eq!(groups.find(&absent), listed);
        }
        assert_eq!(Groups::default().find(&Group::Number(1)), Err("the file's tetrahedra are in no groups".into()));
        let many = Groups { of: (0..25).map(Some).collect(), names: BTreeMap::new() };
        assert!(many.find(&Group::Number(99)).unwrap_err().ends_with("19 and 5 more"));
    }
}
