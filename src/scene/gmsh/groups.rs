//! Reads the physical groups of a mesh file of the mesh generator Gmsh: their names and, in version 4.1 of the file
//! format (MSH), the groups that each entity is in. An *entity* is a point, curve, surface or volume of the geometry, a
//! *tag* is the number of an entity, and a *physical group* is a set of entities with a number.

use std::collections::HashMap;

use super::super::cursor::{Cursor, short};
use super::super::tetrahedra::{Contents, VOLUME};
use super::{real, whole};
use crate::Result;

/// For each entity, by its number of dimensions and its tag, the physical groups that it is in.
pub(super) type Entities = HashMap<(i64, i64), Vec<i64>>;

/// Reads the section `$PhysicalNames`, which is text in binary files too. Each line has the dimension of a group's
/// entities, the group's number and its quoted name.
pub(super) fn names(cursor: &mut Cursor, file: &mut Contents) -> Result<()> {
    const WHAT: &str = "a physical name (dimension, number, name)";
    let line = cursor.need("the number of physical names")?;
    for _ in 0..cursor.parse::<u64>(line, "the number of physical names")? {
        let line = cursor.need(WHAT)?;
        let mut words = line.splitn(3, char::is_whitespace);
        let (dimension, number) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let name = words.next().unwrap_or_default().trim();
        let Some(name) = name.strip_prefix('"').and_then(|name| name.strip_suffix('"')) else {
            return Err(cursor.error(format!("\"{}\" is not valid for {WHAT}", short(line))));
        };
        let (dimension, number): (usize, i64) = (cursor.parse(dimension, WHAT)?, cursor.parse(number, WHAT)?);
        if dimension == VOLUME {
            file.groups.insert(number, name.into());
        } else {
            file.other_groups.insert((dimension, number), name.into());
        }
    }
    cursor.expect("$EndPhysicalNames")
}

/// Reads the section `$Entities` of MSH 4.1, and returns the physical groups of each entity that is in any. Adds a note for
/// a volume that is in several groups.
pub(super) fn entities(cursor: &mut Cursor, file: &mut Contents) -> Result<Entities> {
    let counts = whole(cursor, "the counts of $Entities", 0, 4)?;
    let mut groups = HashMap::new();
    for (dimension, &count) in counts[..=VOLUME].iter().enumerate() {
        for _ in 0..cursor.natural(count, "a count of $Entities")? {
            let (tag, physical) = entity(cursor, dimension)?;
            if physical.is_empty() {
                continue;
            }
            // The file gives a group's number with a minus sign where the entity's orientation is reversed.
            groups.insert((dimension as i64, tag), physical.iter().map(|group| group.saturating_abs()).collect());
            if dimension == VOLUME && physical.len() > 1 {
                let all: Vec<String> = physical.iter().map(i64::to_string).collect();
                let all = all.join(", ");
                file.notes.push(format!("volume {tag} is in physical groups {all}; for materials the first is used"));
            }
        }
    }
    cursor.expect("$EndEntities")?;
    Ok(groups)
}

/// Reads an entity, and returns its tag and its physical groups. An entity in the file is: its tag; its position (of a
/// point) or bounding box; the number of its groups, and these groups; and, unless the entity is a point, the number of
/// entities that bound it, and their tags.
fn entity(cursor: &mut Cursor, dimension: usize) -> Result<(i64, Vec<i64>)> {
    const WHAT: &str = "an entity (tag, place, physical groups)";
    let reals = if dimension == 0 { 3 } else { 6 };
    if cursor.order.is_none() {
        let line = cursor.need(WHAT)?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let Some(count) = words.get(reals + 1) else {
            return Err(cursor.error(format!("{} numbers are too few for {WHAT}", words.len())));
        };
        let tag = cursor.parse(words[0], WHAT)?;
        let count: usize = cursor.parse(count, WHAT)?;
        let physical = count.checked_add(reals + 2).and_then(|end| words.get(reals + 2..end));
        let physical =
            physical.ok_or_else(|| cursor.error(format!("{} numbers are too few for {WHAT}", words.len())))?;
        return Ok((tag, physical.iter().map(|word| cursor.parse(word, WHAT)).collect::<Result<_>>()?));
    }
    let tag = whole(cursor, WHAT, 1, 0)?[0];
    real(cursor, WHAT, reals)?;
    let physical = counted(cursor, WHAT)?;
    if dimension > 0 {
        counted(cursor, WHAT)?;
    }
    Ok((tag, physical))
}

/// Reads a list of four-byte binary integers; its length, an eight-byte integer, comes first.
fn counted(cursor: &mut Cursor, what: &str) -> Result<Vec<i64>> {
    let count = whole(cursor, what, 0, 1)?[0];
    (0..cursor.natural(count, what)?).map(|_| cursor.i32(what).map(i64::from)).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::parse;
    use crate::Result;
    use crate::scene::tetrahedra::TetMesh;

    const NODES: &str = "$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$EndNodes\n";

    fn v2(names: &str, elements: &str) -> Result<TetMesh> {
        let text = format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n{names}\n$EndPhysicalNames\n{NODES}$Elements\n2\n\
             {elements}\n$EndElements\n"
        );
        parse(text.as_bytes(), Path::new("t.msh"))
    }

    fn v4(entities: &str) -> Result<TetMesh> {
        let text = format!(
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 5 \"skin\"\n3 5 \"fat\"\n$EndPhysicalNames\n\
             $Entities\n{entities}\n$EndEntities\n$Nodes\n1 5 1 5\n3 1 0 5\n1\n2\n3\n4\n5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n\
             1 1 1\n$EndNodes\n$Elements\n2 2 1 2\n3 1 4 1\n1 1 2 3 4\n3 8 4 1\n2 2 3 4 5\n$EndElements\n"
        );
        parse(text.as_bytes(), Path::new("t.msh"))
    }

    #[test]
    fn version_2_2_takes_the_first_tag() {
        let mesh = v2("2\n2 5 \"skin\"\n3 7 \"soft fat\"", "1 4 2 7 1 1 2 3 4\n2 4 2 0 1 2 3 4 5").unwrap();
        assert_eq!(mesh.groups.of, [Some(7), None]);
        assert_eq!(mesh.groups.names, [(7, "soft fat".to_string())].into());
        let named: Vec<String> = mesh.groups.of_nodes.iter().map(|group| group.to_string()).collect();
        assert_eq!(named, ["7 \"soft fat\" (volumes)"]);
        let mesh = v2("1\n2 5 \"skin\"", "1 2 2 5 1 2 3 4\n2 4 2 0 1 2 3 4 5").unwrap();
        let [skin] = &mesh.groups.of_nodes[..] else { panic!("{:?}", mesh.groups) };
        assert_eq!((skin.to_string().as_str(), &skin.nodes[..]), ("5 \"skin\" (faces)", &[1, 2, 3][..]));
        assert_eq!(v2("0", "1 4 0 1 2 3 4\n2 4 1 3 2 3 4 5").unwrap().groups.of, [None, Some(3)]);
    }

    #[test]
    fn version_4_1_takes_the_first_group_of_the_volume() {
        let mesh =
            v4("1 1 0 2\n1 0 0 0 0\n1 0 0 0 1 1 1 0 2 1 -1\n1 0 0 0 1 1 1 0 0\n8 0 0 0 1 1 1 2 -5 6 1 2").unwrap();
        assert_eq!(mesh.groups.of, [None, Some(5)]);
        assert_eq!(mesh.groups.names, [(5, "fat".to_string())].into());
        assert!(
            mesh.notes
                .iter()
                .any(|note| note.contains("volume 8 is in physical groups -5, 6; for materials the first"))
        );
        let [fat, six] = &mesh.groups.of_nodes[..] else { panic!("{:?}", mesh.groups) };
        assert_eq!((six.to_string().as_str(), &six.nodes), ("6 (volumes)", &fat.nodes));
        assert_eq!((fat.to_string().as_str(), &fat.nodes[..]), ("5 \"fat\" (volumes)", &[1, 2, 3, 4][..]));
        // A point, a line and a triangle, on entities that are in one, two and no groups.
        let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 1 1 1\n1 0 0 0 1 4\n1 0 0 0 1 1 1 2 4 9 0\n\
                    1 0 0 0 1 1 1 0 0\n1 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n\
                    0 1 0\n0 0 1\n$EndNodes\n$Elements\n4 4 1 4\n0 1 15 1\n1 1\n1 1 1 1\n2 1 3\n2 1 2 1\n3 2 3 4\n\
                    3 1 4 1\n4 1 2 3 4\n$EndElements\n";
        let mesh = parse(text.as_bytes(), Path::new("t.msh")).unwrap();
        let all: Vec<_> = mesh.groups.of_nodes.iter().map(|group| (group.to_string(), group.nodes.clone())).collect();
        let want = [("4 (points)", vec![0]), ("4 (lines)", vec![0, 2]), ("9 (lines)", vec![0, 2])];
        assert_eq!(all, want.map(|(name, nodes)| (name.to_string(), nodes)));
    }

    #[test]
    fn binary_entities_are_as_those_in_text() {
        for big in [false, true] {
            let mut bytes = b"$MeshFormat\n4.1 1 8\n".to_vec();
            let mut put = |raw: &[u8]| bytes.extend(raw.iter().rev().copied().collect::<Vec<_>>());
            let int = |x: i32| if big { x.to_le_bytes() } else { x.to_be_bytes() };
            let size = |x: u64| if big { x.to_le_bytes() } else { x.to_be_bytes() };
            let real = |x: f64| if big { x.to_le_bytes() } else { x.to_be_bytes() };
            put(&int(1));
            put(b"\n$Entities\n".iter().rev().copied().collect::<Vec<_>>().as_slice());
            [0, 1, 0, 1].iter().for_each(|&n| put(&size(n)));
            for groups in [vec![], vec![4, 9]] {
                put(&int(2));
                (0..6).for_each(|_| put(&real(0.5)));
                put(&size(groups.len() as u64));
                groups.iter().for_each(|&group| put(&int(group)));
                put(&size(1));
                put(&int(3));
            }
            bytes.extend(b"\n$EndEntities\n");
            let mut cursor = super::Cursor::new(Path::new("t.msh"), &bytes, "");
            let mut file = super::Contents::default();
            cursor.expect("$MeshFormat").unwrap();
            cursor.next_line();
            cursor.order =
                Some(if big { crate::scene::cursor::Order::Big } else { crate::scene::cursor::Order::Little });
            cursor.i32("one").unwrap();
            cursor.expect("$Entities").unwrap();
            assert_eq!(super::entities(&mut cursor, &mut file).unwrap(), [((3, 2), vec![4, 9])].into());
        }
    }

    #[test]
    fn damage_is_told_by_line() {
        let tetrahedra = "1 4 2 7 1 1 2 3 4\n2 4 2 7 1 2 3 4 5";
        for (names, words) in [
            ("1\n3 7 fat", "t.msh:6: \"3 7 fat\" is not valid for a physical name"),
            ("1\n3 x \"fat\"", "t.msh:6: \"x\" is not valid for a physical name"),
            ("many", "t.msh:5: \"many\" is not valid for the number of physical names"),
            ("2\n3 7 \"fat\"", "t.msh:7: \"$EndPhysicalNames\" is not valid for a physical name"),
        ] {
            let message = v2(names, tetrahedra).unwrap_err().to_string();
            assert!(message.contains(words), "expected `{words}` in the error: {message}");
        }
        for (entities, words) in [
            ("0 0 0 1\n1 0 0 0 1 1 1", "t.msh:11: 7 numbers are too few for an entity"),
            ("0 0 0 1\n1 0 0 0 1 1 1 3 5", "t.msh:11: 9 numbers are too few for an entity"),
            ("0 0 0 1\n1 0 0 0 1 1 1 18446744073709551615 5", "t.msh:11: 9 numbers are too few for an entity"),
            ("0 0 0 2\n1 0 0 0 1 1 1 0 0", "t.msh:12: 1 numbers are too few for an entity"),
            ("0 0 0 -1", "t.msh:10: -1 is not valid for a count"),
        ] {
            let message = v4(entities).unwrap_err().to_string();
            assert!(message.contains(words), "expected `{words}` in the error: {message}");
        }
    }
}
