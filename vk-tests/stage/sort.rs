//! Tests of kernel contact/sort. An entry is a pair (node, weight) of a contact; a contact has up to four groups of
//! four entries. The kernel is given, for each node, linked lists of the entries that name it, in any order, and writes
//! the entries node after node into one array, where each node's entries form a run, in a fixed order.

use std::collections::BTreeMap;

use bytemuck::Zeroable;
use palpate::internal::gpu::DeviceKind;
use palpate::internal::shaders;
use palpate::internal::shaders::{Contact, Counts, NONE};
use palpate::internal::stages::depth::Path;

use crate::harness::bodies::{half_space, rigid, sphere, whole};
use crate::harness::context;
use crate::harness::random::Random;
use crate::stage::contact::crowd;
use crate::stage::flow::Flow;

/// The flag that some contacts are missing.
const CONTACT_OVERFLOW: u32 = 4;

/// The runs that are expected: contact and weight bits of each node's entries, in rising order of entries.
fn wanted(flow: &Flow) -> BTreeMap<usize, Vec<[u32; 2]>> {
    let mut runs: BTreeMap<usize, Vec<[u32; 2]>> = BTreeMap::new();
    for (c, contact) in flow.contacts[..flow.counts.contacts as usize].iter().enumerate() {
        for quad in 4 * c..4 * c + contact.quads as usize {
            for (node, weight) in flow.entry_nodes[quad].iter().zip(flow.entry_weights[quad]) {
                if weight != 0.0 {
                    runs.entry(*node as usize).or_default().push([c as u32, weight.to_bits()]);
                }
            }
        }
    }
    runs
}

/// Checks that every node's run holds exactly its entries in rising order, and that the runs cover the array without
/// gaps. Returns the number of entries.
fn check(flow: &Flow) -> usize {
    let want = wanted(flow);
    let mut covered = vec![false; flow.sorted.len()];
    for (node, [first, count]) in flow.node_entries.iter().enumerate() {
        let (first, count) = (*first as usize, *count as usize);
        let run = &flow.sorted[first..first + count];
        assert!(
            run == want.get(&node).map_or(&[][..], |run| run),
            "the run of node {node} is not its entries in order"
        );
        if count > 0 {
            covered[first..first + count].iter_mut().for_each(|c| {
                assert!(!*c, "the run of node {node} overlaps another");
                *c = true;
            });
        }
    }
    assert!(covered.iter().all(|c| *c) && flow.counts.entries as usize == covered.len());
    assert!(flow.node_list_counts.iter().all(|n| *n == 0), "counts must be zero for the next step");
    assert!(flow.node_lists.iter().all(|head| *head == NONE), "lists must be empty for the next step");
    assert_eq!(flow.counts.flags, 0);
    covered.len()
}

/// `n` made-up contacts with entries at random nodes of `nodes`; some entries have weight zero.
fn made_up(n: usize, nodes: u32, random: &mut Random) -> Flow {
    let tool = rigid("tool", sphere(1.0, 0), whole, glam::DVec3::ZERO, glam::DQuat::IDENTITY);
    let mut flow = Flow::new(&[half_space(glam::DVec3::Y, 0.0)], Some(&tool), glam::DVec3::ZERO);
    let mut pick = |below: u32| ((random.next() + 1.0) * 0.5 * f64::from(below)) as u32;
    flow.contacts = (0..n).map(|_| Contact { quads: pick(5), ..Contact::zeroed() }).collect();
    flow.entry_nodes = (0..4 * n).map(|_| [(); 4].map(|()| pick(nodes))).collect();
    flow.entry_weights = (0..4 * n).map(|_| [(); 4].map(|()| pick(5) as f32 * 0.25)).collect();
    // Groups of four entries that a contact does not use hold values of an earlier step.
    for (c, contact) in flow.contacts.iter().enumerate() {
        for quad in 4 * c + contact.quads as usize..4 * c + 4 {
            (flow.entry_nodes[quad], flow.entry_weights[quad]) = ([NONE; 4], [9.0; 4]);
        }
    }
    flow.counts = Counts { contacts: n as u32, ..Counts::default() };
    list(&mut flow, nodes as usize, random);
    flow
}

/// Makes the linked lists of each node's entries, taking the contacts in random order, and the list of touched nodes
/// (nodes with entries), also in random order.
fn list(flow: &mut Flow, nodes: usize, random: &mut Random) {
    flow.forget_entries(nodes);
    let lists = context().reduce_size() as usize;
    flow.next_entries = vec![NONE; 16 * flow.contacts.len()];
    let mut order: Vec<usize> = (0..flow.contacts.len()).collect();
    shuffle(&mut order, random);
    for c in order {
        for e in 16 * c..16 * c + 4 * flow.contacts[c].quads as usize {
            let (node, weight) = (flow.entry_nodes[e / 4][e % 4] as usize, flow.entry_weights[e / 4][e % 4]);
            if weight != 0.0 {
                flow.next_entries[e] = std::mem::replace(&mut flow.node_lists[node * lists + c % lists], e as u32);
                flow.node_list_counts[node] += u32::from(flow.next_entries[e] == NONE);
            }
        }
    }
    flow.touched_nodes = (0..nodes as u32).filter(|node| flow.node_list_counts[*node as usize] > 0).collect();
    shuffle(&mut flow.touched_nodes, random);
    flow.args[3 * shaders::ARGS_NODES as usize] = flow.touched_nodes.len() as u32;
}

fn shuffle<T>(work_items: &mut [T], random: &mut Random) {
    (1..work_items.len()).for_each(|k| work_items.swap(k, random.below(k + 1)));
}

#[test]
fn two_contacts_by_hand() {
    let mut flow = made_up(2, 3, &mut Random(1));
    flow.contacts = vec![Contact { quads: 1, ..Contact::zeroed() }, Contact { quads: 2, ..Contact::zeroed() }];
    flow.entry_nodes = vec![[2, 0, 0, 1]; 8];
    flow.entry_weights = vec![[0.0; 4]; 8];
    flow.entry_weights[0] = [0.5, 0.0, 0.25, 0.0];
    flow.entry_weights[4] = [-1.0, 0.0, 0.0, 0.0];
    flow.entry_weights[5] = [0.0, 0.125, 2.0, 0.0];
    list(&mut flow, 3, &mut Random(2));
    flow.sort();
    let [first, count] = flow.node_entries[0];
    assert_eq!((count, flow.node_entries[1], flow.node_entries[2][1]), (3, [0, 0], 2));
    let bits = |c: u32, w: f32| [c, w.to_bits()];
    assert_eq!(flow.sorted[first as usize..][..3], [bits(0, 0.25), bits(1, 0.125), bits(1, 2.0)]);
    let first = flow.node_entries[2][0] as usize;
    assert_eq!(flow.sorted[first..first + 2], [bits(0, 0.5), bits(1, -1.0)]);
    assert_eq!(check(&flow), 5);
}

#[test]
fn any_number_of_contacts_and_nodes() {
    let width = context().group_size();
    let mut random = Random(71);
    for n in [0, 1, width - 1, width, width + 1, 1234] {
        for nodes in [1, width - 1, width + 1, 1234] {
            let mut flow = made_up(n as usize, nodes, &mut random);
            flow.sort();
            check(&flow);
        }
    }
}

#[test]
fn the_crowd_s_contacts_are_indexed_whole() {
    let (_, _, flow) = crowd(Path::Compute);
    assert!(check(&flow) > 800, "only {} entries", flow.counts.entries);
}

/// The entries of one node are spread over the whole array of entries, so that they lie in more than one of the windows
/// of 65,536 entries that contact/sort treats at a time. If a driver ends loops early, a flag must be raised.
#[test]
fn runs_longer_than_a_window_are_in_order() {
    for (n, stride) in [(10_000, 1), (10_000, 2_500), (4_097, 4_096), (32_768, 1)] {
        let mut flow = made_up(n, 3, &mut Random(73));
        // All entries are at the last node, except those of every `stride`th contact, which are at the first.
        for (c, quad) in flow.entry_nodes.chunks_mut(4).enumerate() {
            quad.fill(if c % stride == 0 { [0; 4] } else { [2; 4] });
        }
        list(&mut flow, 3, &mut Random(74));
        flow.sort();
        if n > 10_000 && context().kind() == DeviceKind::Cpu && flow.counts.flags == CONTACT_OVERFLOW {
            assert!(flow.node_list_counts.iter().all(|n| *n == 0) && flow.node_lists.iter().all(|head| *head == NONE));
            println!("{n} contacts on one node: the driver left a loop early, which is flagged");
            continue;
        }
        assert!(check(&flow) > 4 * n);
    }
}

#[test]
fn the_same_contacts_give_the_same_runs_again() {
    let mut flow = made_up(300, 40, &mut Random(72));
    let mut again = made_up(300, 40, &mut Random(72));
    flow.sort();
    again.sort();
    let run = |flow: &Flow, node: usize| {
        let [first, count] = flow.node_entries[node];
        flow.sorted[first as usize..(first + count) as usize].to_vec()
    };
    (0..40).for_each(|node| assert_eq!(run(&flow, node), run(&again, node)));
}
