//! contact/response beyond what vk-tests/contact.rs holds against the oracle: the quads of entries.

use palpate::stages::depth::Path;
use palpate::stages::types::NONE;

use crate::contact::crowd;
use crate::flow::Flow;

/// The distinct tetrahedra behind a contact's points: the gathered vertex, then the corners of the opposing triangle.
fn tetrahedra(flow: &Flow, c: usize) -> Vec<[u32; 4]> {
    let contact = &flow.contacts[c];
    let mut vertices = vec![contact.vertex];
    if contact.triangle != NONE {
        vertices.extend(&flow.model.triangles[contact.triangle as usize][..3]);
    }
    let mut distinct: Vec<[u32; 4]> = Vec::new();
    for nodes in vertices.into_iter().map(|v| flow.model.skin_nodes[v as usize]) {
        if nodes[0] != NONE && !distinct.contains(&nodes) {
            distinct.push(nodes);
        }
    }
    distinct
}

#[test]
fn corners_in_one_tetrahedron_share_a_quad() {
    let (_, _, flow) = crowd(Path::Compute);
    let (mut saved, mut kept) = (0, 0);
    for (c, contact) in flow.contacts.iter().enumerate() {
        let want = tetrahedra(&flow, c);
        let quads = 4 * c..4 * c + contact.quads as usize;
        assert_eq!(flow.entry_nodes[quads.clone()], want, "contact {c}");
        // Each body's weights sum to one, with its sign; a body without nodes has none.
        let sum: f32 = flow.entry_weights[quads].iter().flatten().sum();
        assert!((sum - sum.round()).abs() < 1e-5 && sum.abs() < 1.5, "contact {c}: weights sum to {sum}");
        let corners = flow.model.skin_nodes[contact.vertex as usize][0] != NONE;
        let soft_triangle = contact.triangle != NONE
            && flow.model.skin_nodes[flow.model.triangles[contact.triangle as usize][0] as usize][0] != NONE;
        saved += usize::from(corners) + if soft_triangle { 3 } else { 0 } - want.len();
        kept += want.len();
    }
    println!("{} contacts: {kept} quads, {saved} shared", flow.contacts.len());
    assert!(saved > 20 && kept > 100);
}
