//! Groups in a mesh file: of tetrahedra, and of nodes. A material region (a part of a soft body with its own material) may
//! be given as a group of tetrahedra; the nodes of a core or of a support as a group of nodes. Each file format has its own
//! name for groups; Gmsh calls them physical groups.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};

use super::Group;

/// Greatest number of groups that an error lists.
const MOST_LISTED: usize = 20;

/// The group that each tetrahedron is in, and the groups of nodes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Groups {
    /// Number of each tetrahedron's group; `None`: the tetrahedron is in no group. A generated mesh has an empty list.
    pub of: Vec<Option<i64>>,
    /// Names of the groups, by number; a group may have no name.
    pub names: BTreeMap<i64, String>,
    /// The groups of nodes.
    pub of_nodes: Vec<NodeGroup>,
}

/// The nodes of the elements that a file puts into one group.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeGroup {
    /// Number of dimensions of the elements: 0 for points, 1 for lines, 2 for faces, 3 for volumes. Groups of different
    /// dimensions may have the same number.
    pub dimension: usize,
    /// Number of the group.
    pub number: i64,
    /// Name of the group, if it has one.
    pub name: Option<String>,
    /// Its nodes, in the order and with the numbering of the file's nodes, ascending.
    pub nodes: Vec<u32>,
}

impl fmt::Display for NodeGroup {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let kind = ["points", "lines", "faces", "volumes"].get(self.dimension).unwrap_or(&"elements");
        match &self.name {
            Some(name) => write!(f, "{} \"{}\" ({kind})", self.number, name.escape_debug()),
            None => write!(f, "{} ({kind})", self.number),
        }
    }
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

    /// The nodes of a group. If there is no such group, or several have its number, the error is a problem and its remedy,
    /// which lists the groups.
    pub fn nodes_of(&self, group: &Group) -> Result<&[u32], (String, String)> {
        let is_it = |own: &&NodeGroup| match group {
            Group::Number(wanted) => own.number == *wanted,
            Group::Name(wanted) => own.name.as_ref() == Some(wanted),
        };
        let found: Vec<&NodeGroup> = self.of_nodes.iter().filter(is_it).collect();
        let wanted = match group {
            Group::Number(number) => number.to_string(),
            Group::Name(name) => format!("\"{}\"", name.escape_debug()),
        };
        match &found[..] {
            [one] => Ok(&one.nodes),
            [] => {
                Err((format!("there is no group {wanted} with nodes"), list(&self.of_nodes.iter().collect::<Vec<_>>())))
            }
            several => {
                let listed: Vec<String> = several.iter().map(|group| group.to_string()).collect();
                let remedy = format!("rename all but one in the file: {}", listed.join(", "));
                Err((format!("there are {} groups {wanted}", several.len()), remedy))
            }
        }
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

/// Lists groups of nodes.
fn list(groups: &[&NodeGroup]) -> String {
    if groups.is_empty() {
        return "the body's mesh has no groups; give the nodes in another way, or a mesh file with groups".into();
    }
    let listed: Vec<String> = groups.iter().take(MOST_LISTED).map(|group| group.to_string()).collect();
    let more = groups.len().saturating_sub(MOST_LISTED);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("the file's groups are {}{rest}", listed.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_found_by_the_name_of_their_group_or_its_number() {
        let group = |dimension, number, name: Option<&str>, nodes: &[u32]| NodeGroup {
            dimension,
            number,
            name: name.map(Into::into),
            nodes: nodes.to_vec(),
        };
        let of_nodes = vec![group(2, 5, Some("left"), &[1, 4]), group(3, 5, None, &[0, 1]), group(0, 7, None, &[2])];
        let groups = Groups { of_nodes, ..Groups::default() };
        assert_eq!(groups.nodes_of(&Group::Name("left".into())), Ok(&[1, 4][..]));
        assert_eq!(groups.nodes_of(&Group::Number(7)), Ok(&[2][..]));
        let (problem, remedy) = groups.nodes_of(&Group::Number(5)).unwrap_err();
        assert_eq!(
            (problem.as_str(), remedy.as_str()),
            ("there are 2 groups 5", "rename all but one in the file: 5 \"left\" (faces), 5 (volumes)")
        );
        let (problem, remedy) = groups.nodes_of(&Group::Name("right".into())).unwrap_err();
        assert_eq!(problem, "there is no group \"right\" with nodes");
        assert_eq!(remedy, "the file's groups are 5 \"left\" (faces), 5 (volumes), 7 (points)");
        assert!(Groups::default().nodes_of(&Group::Number(1)).unwrap_err().1.contains("has no groups"));
    }

    #[test]
    fn groups_are_found_by_name_or_number_and_listed_where_they_are_not() {
        let names = [(3, "fat".into()), (7, "empty".into())].into();
        let groups = Groups { of: vec![Some(3), None, Some(-1), Some(3)], names, ..Groups::default() };
        assert_eq!(groups.find(&Group::Name("fat".into())), Ok(3));
        assert_eq!(groups.find(&Group::Number(-1)), Ok(-1));
        let listed = Err("the file's groups are -1, 3 \"fat\"".to_string());
        for absent in [Group::Name("empty".into()), Group::Name("3".into()), Group::Number(7)] {
            assert_eq!(groups.find(&absent), listed);
        }
        assert_eq!(Groups::default().find(&Group::Number(1)), Err("the file's tetrahedra are in no groups".into()));
        let many = Groups { of: (0..25).map(Some).collect(), ..Groups::default() };
        assert!(many.find(&Group::Number(99)).unwrap_err().ends_with("19 and 5 more"));
    }
}
