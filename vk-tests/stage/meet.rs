//! Tests of kernel cull/meet, which joins the lists of chunks of all pair proxies into a single list, in the order of
//! pair proxies, and raises a flag if not all fit. A chunk is a group of up to 64 skin vertices; a pair proxy is a
//! collision proxy (convex hull) in a pair of bodies; a work item is a chunk in a contact patch (place where a pair may
//! touch).

use palpate::internal::gpu::Size;
use palpate::internal::shaders;
use palpate::internal::shaders::{ActiveChunk, ContactPatch, Counts, NONE, Pair, PairProxy, Proxy};
use palpate::internal::stages::ARGS_WORDS;
use palpate::internal::stages::PAIR_PATCHES;

use crate::harness::random::Random;
use crate::harness::{case, context};

/// The flag that not all work items fit.
const REGION_OVERFLOW: u32 = 2;

#[test]
fn lists_of_slots_are_joined_in_order() {
    let mut random = Random(85);
    let width = context().reduce_size() as usize;
    for pair_proxies in [1, width - 1, width, width + 1, 123] {
        let (mut given, mut chunks, mut proxies, mut all) = (vec![], vec![], vec![], 0);
        for s in 0..pair_proxies as u32 {
            let chunk_first = chunks.len() as u32;
            given.push(PairProxy { pair: s / 5, side: s % 2, proxy: s, chunk_first });
            let (mut work_items, count) = (0, if random.next() > 0.0 { random.below(7) } else { 0 });
            for _ in 0..count {
                let mask = random.below(16) as u32;
                chunks.push([mask, NONE]);
                work_items += mask.count_ones();
            }
            // Each pair proxy has room for one more chunk than it lists.
            chunks.push([NONE; 2]);
            proxies.push(Proxy {
                chunk_first: random.below(5000) as u32,
                chunk_count: count as u32,
                ..Proxy::default()
            });
            all += work_items;
        }
        let mut active: Vec<u32> =
            (0..pair_proxies as u32).filter(|s| proxies[*s as usize].chunk_count > 0 || s % 2 == 0).collect();
        (1..active.len()).for_each(|k| active.swap(k, random.below(k + 1)));
        let gathering = random.below(pair_proxies + 1);
        for most in [all.max(1) as usize, all as usize + 3, (all as usize / 2).max(1)] {
            // Each pair is a body and a half-space: there the kernel keeps every chunk, since it drops chunks only
            // against skins.
            let out = case("cull/meet")
                .size(Size::Reduce)
                .constant("PAIR_PROXIES", pair_proxies as u32)
                .constant("MAX_WORK_ITEMS", most as u32)
                .constant("GATHERING", gathering as u32)
                .input("pairs", &vec![Pair { is_plane: 1, ..Pair::default() }; pair_proxies / 5 + 1])
                .input("pair_proxies", &given)
                .input("active_pair_proxies", &active)
                .input("proxies", &proxies)
                .input("contact_patches", &[ContactPatch::default()])
                .input("slabs", &[[0.0f32; 8]])
                .input("depth_grids", &[0u32; 4])
                .inout("pair_proxy_chunks", &chunks)
                .inout("pair_proxy_counts", &vec![[0u32; 2]; pair_proxies])
                .partial("active_chunks", &vec![ActiveChunk { chunk: NONE, ..Default::default() }; most])
                .partial("work_items", &vec![[NONE; 2]; most])
                .inout("counts", &[Counts::default()])
                .partial("args", &vec![7u32; ARGS_WORDS])
                .groups(active.len())
                .run();
            let (mut want, mut work_items) = (vec![], vec![]);
            for (s, pair_proxy) in given.iter().enumerate() {
                let own = &chunks[pair_proxy.chunk_first as usize..][..proxies[s].chunk_count as usize];
                for (k, [found, _]) in own.iter().enumerate().filter(|(_, [found, _])| *found != 0) {
                    let (first_work_item, index) = (work_items.len() as u32, want.len() as u32);
                    let mut contact_patches = 0;
                    for r in (0..PAIR_PATCHES as u32).filter(|r| found >> r & 1 == 1) {
                        // Work items that do not fit are left out: those at the end of the list.
                        contact_patches |= if work_items.len() < most { 1 << r } else { 0 };
                        work_items.push([index, pair_proxy.pair * PAIR_PATCHES as u32 + r]);
                    }
                    let (pair_proxy_index, side) = (s as u32, 2 * pair_proxy.pair + pair_proxy.side);
                    let chunk = proxies[s].chunk_first + k as u32;
                    want.push(ActiveChunk {
                        chunk,
                        pair_proxy: pair_proxy_index,
                        side,
                        contact_patches,
                        first_work_item,
                    });
                }
            }
            let fits = all as usize <= most;
            want.truncate(most);
            work_items.truncate(most);
            assert_eq!(out.get::<ActiveChunk>("active_chunks")[..want.len()], want);
            let listed: Vec<[u32; 2]> = out.get("work_items");
            assert_eq!(listed[..work_items.len()], work_items);
            assert!(listed[work_items.len()..].iter().all(|work_item| work_item[0] == NONE));
            let count = out.get::<Counts>("counts")[0];
            let flags = if fits { 0 } else { REGION_OVERFLOW };
            assert_eq!(
                (count.chunks as usize, count.work_items as usize, count.flags),
                (want.len(), work_items.len(), flags)
            );
            let words: Vec<u32> = out.get("args");
            let groups = |pair_proxy: u32| words[3 * pair_proxy as usize] as usize;
            assert_eq!(
                [groups(shaders::ARGS_ACTIVE), groups(shaders::ARGS_WORK_ITEMS)],
                [want.len(), work_items.len()]
            );
            let gather = want.iter().filter(|entry| (entry.pair_proxy as usize) < gathering).count();
            assert_eq!([groups(shaders::ARGS_GATHERING), count.gathering as usize], [gather; 2]);
            let tested = work_items.iter().filter(|item| (item[0] as usize) < gather).count();
            assert_eq!(groups(shaders::ARGS_OVERLAPS), tested);
            assert_eq!(
                words[3 * shaders::ARGS_DRAW as usize + 1] as usize,
                work_items.len(),
                "number of instances to draw"
            );
        }
    }
}
