//! Divides the nodes of a soft body's tetrahedral mesh into clusters of neighbouring nodes, before the first step. The
//! clusters are the *aggregates* of the coarse space, by which the solver preconditions the linear system of a step.
//!
//! The method is Lloyd's iteration (1982) on the mesh graph, as Bell (2008) uses it for algebraic multigrid. A cluster
//! grows from the node nearest to the cluster's centre. Of all nodes adjacent to the cluster, the node nearest to the
//! centre joins next, so that no cluster jumps across the gap between parts of the body which nearly meet, such as
//! fingers. Then the centre moves to the mean of the cluster's nodes. The first centres are chosen far from each other
//! (Gonzalez 1985), with distances in units of the local element size, so that clusters of small tetrahedra are small:
//! small tetrahedra are stiff, and a cluster with many of them would leave too much to the Jacobi part of the
//! preconditioner.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

/// Number of Lloyd iterations; further iterations hardly change the clusters.
const ROUNDS: usize = 5;
/// How many times element sizes are averaged over adjacent nodes, so that clusters follow the local fineness of a mesh
/// and not the sizes of single tetrahedra, such as small tetrahedra at the mesh's surface.
const EVENED: usize = 4;

/// The nodes of a mesh and their adjacency.
pub struct Graph {
    places: Vec<DVec3>,
    sizes: Vec<f64>,
    /// For each node, the index of its first neighbour in `neighbours`; one more entry has the length of `neighbours`.
    first: Vec<usize>,
    neighbours: Vec<u32>,
}

impl Graph {
    /// Makes the graph. `places`: positions of the nodes, m; `sizes`: the local element size at each node, in any unit,
    /// above 0; `elements`: the nodes of each element, which become adjacent to each other.
    pub fn new(places: Vec<DVec3>, sizes: Vec<f64>, elements: impl Iterator<Item = Vec<u32>>) -> Graph {
        let mut edges: Vec<(u32, u32)> = Vec::new();
        for element in elements {
            for i in &element {
                edges.extend(element.iter().filter(|j| *j != i).map(|j| (*i, *j)));
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let first = (0..=places.len()).map(|i| edges.partition_point(|edge| (edge.0 as usize) < i)).collect();
        let neighbours = edges.into_iter().map(|edge| edge.1).collect();
        let mut graph = Graph { places, sizes, first, neighbours };
        for _ in 0..EVENED {
            graph.sizes = (0..graph.sizes.len()).map(|node| graph.mean_size(node)).collect();
        }
        graph
    }

    fn neighbours(&self, node: usize) -> &[u32] {
        &self.neighbours[self.first[node]..self.first[node + 1]]
    }

    /// Mean element size over a node and its neighbours.
    fn mean_size(&self, node: usize) -> f64 {
        let others = self.neighbours(node);
        let sum = others.iter().fold(self.sizes[node], |sum, other| sum + self.sizes[*other as usize]);
        sum / (1 + others.len()) as f64
    }

    /// Assigns every node to one of `count` clusters (of one cluster if `count` is 0), and returns each node's cluster.
    /// Some clusters may stay empty.
    pub fn aggregates(&self, count: usize) -> Vec<usize> {
        let mut seeds = self.far_apart(count);
        let mut centres: Vec<DVec3> = seeds.iter().map(|seed| self.places[*seed]).collect();
        let mut own = self.grown(&seeds, &centres);
        for _ in 1..ROUNDS {
            self.centre(&own, &mut seeds, &mut centres);
            own = self.grown(&seeds, &centres);
        }
        own
    }

    /// Chooses `count` seed nodes, from which clusters grow. Each is as far as possible from the seeds chosen before,
    /// by distances in units of the element size at the node.
    fn far_apart(&self, count: usize) -> Vec<usize> {
        let mut seeds = Vec::new();
        let mut distances = vec![f64::INFINITY; self.places.len()];
        let mut newest = (!self.places.is_empty()).then_some(0);
        while let Some(seed) = newest {
            seeds.push(seed);
            let centre = self.places[seed];
            distances.iter_mut().zip(&self.places).for_each(|(d, x)| *d = d.min(x.distance_squared(centre)));
            let far = |i: &usize| distances[*i] / (self.sizes[*i] * self.sizes[*i]);
            newest = (0..distances.len()).filter(|_| seeds.len() < count).max_by(|a, b| far(a).total_cmp(&far(b)));
        }
        seeds
    }

    /// Grows a cluster from each seed node along the mesh, and returns each node's cluster. A node that no cluster
    /// reaches joins the cluster with the nearest centre.
    fn grown(&self, seeds: &[usize], centres: &[DVec3]) -> Vec<usize> {
        let mut own = vec![usize::MAX; self.places.len()];
        let mut least = vec![u64::MAX; self.places.len()];
        let mut next = BinaryHeap::new();
        // The bit patterns of non-negative floats sort like their values.
        let to = |node: usize, aggregate: usize| self.places[node].distance_squared(centres[aggregate]).to_bits();
        next.extend(
            seeds.iter().enumerate().map(|(aggregate, seed)| Reverse((to(*seed, aggregate), *seed, aggregate))),
        );
        while let Some(Reverse((_, node, aggregate))) = next.pop() {
            if own[node] != usize::MAX {
                continue;
            }
            own[node] = aggregate;
            for &other in self.neighbours(node) {
                let (other, distance) = (other as usize, to(other as usize, aggregate));
                if own[other] == usize::MAX && distance < least[other] {
                    least[other] = distance;
                    next.push(Reverse((distance, other, aggregate)));
                }
            }
        }
        for (node, own) in own.iter_mut().enumerate().filter(|(_, own)| **own == usize::MAX) {
            *own = (0..centres.len()).min_by_key(|aggregate| to(node, *aggregate)).unwrap_or_default();
        }
        own
    }

    /// Moves each centre to the mean of its cluster's nodes, and each seed to the cluster's node nearest to that
    /// centre.
    fn centre(&self, own: &[usize], seeds: &mut [usize], centres: &mut [DVec3]) {
        let mut sums = vec![(DVec3::ZERO, 0.0); centres.len()];
        own.iter().zip(&self.places).for_each(|(own, x)| sums[*own] = (sums[*own].0 + *x, sums[*own].1 + 1.0));
        let means = sums.iter().zip(centres.iter_mut()).filter(|((_, n), _)| *n > 0.0);
        means.for_each(|((sum, n), centre)| *centre = *sum / *n);
        let mut least = vec![f64::INFINITY; centres.len()];
        for (node, (own, x)) in own.iter().zip(&self.places).enumerate() {
            let distance = x.distance_squared(centres[*own]);
            if distance < least[*own] {
                (least[*own], seeds[*own]) = (distance, node);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of nodes along x; successive nodes of a row are 1 m apart and adjacent. A row is given by its y coordinate
    /// (m), its number of nodes, and the element size at these nodes.
    fn rows(rows: &[(f64, usize, f64)]) -> Graph {
        let (mut places, mut sizes, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
        for (y, count, size) in rows {
            let first = places.len() as u32;
            places.extend((0..*count).map(|i| DVec3::new(i as f64, *y, 0.0)));
            sizes.extend(vec![*size; *count]);
            pairs.extend((1..*count as u32).map(|i| vec![first + i - 1, first + i]));
        }
        Graph::new(places, sizes, pairs.into_iter())
    }

    /// Number of nodes in each of `count` clusters; `own` is the cluster of each node.
    fn counts(own: &[usize], count: usize) -> Vec<usize> {
        (0..count).map(|k| own.iter().filter(|own| **own == k).count()).collect()
    }

    #[test]
    fn a_row_falls_into_parts_of_about_one_size() {
        let own = rows(&[(0.0, 12, 1.0)]).aggregates(3);
        assert!(
            counts(&own, 3).iter().all(|count| (3..=5).contains(count)),
            "every cluster must have 3 to 5 nodes; cluster of each node: {own:?}"
        );
        assert_eq!(
            own.windows(2).filter(|pair| pair[0] != pair[1]).count(),
            2,
            "number of places where the cluster changes along the row; cluster of each node: {own:?}"
        );
    }

    #[test]
    fn rows_that_nearly_meet_stay_apart() {
        let own = rows(&[(0.0, 20, 1.0), (0.1, 20, 1.0)]).aggregates(4);
        assert!(
            (0..4).all(|k| own[..20].contains(&k) != own[20..].contains(&k)),
            "every cluster must have nodes of one row only; cluster of each node: {own:?}"
        );
    }

    #[test]
    fn small_tetrahedra_get_more_aggregates() {
        let own = rows(&[(0.0, 30, 1.0), (1000.0, 30, 0.2)]).aggregates(12);
        let of = |part: &[usize]| (0..12).filter(|k| part.contains(k)).count();
        assert!(
            of(&own[30..]) >= 2 * of(&own[..30]),
            "the row of small elements needs at least twice the clusters of the other; cluster of each node: {own:?}"
        );
    }

    #[test]
    fn every_node_is_in_one_whatever_the_count() {
        assert!(rows(&[]).aggregates(3).is_empty());
        assert_eq!(rows(&[(0.0, 5, 1.0)]).aggregates(0), [0; 5]);
        // No seed lies in the second row, so its nodes join the nearest cluster.
        assert_eq!(rows(&[(0.0, 3, 1.0), (1.0, 3, 1.0)]).aggregates(1), [0; 6]);
        let own = rows(&[(0.0, 3, 1.0)]).aggregates(7);
        assert!(own[0] != own[1] && own[1] != own[2] && own[0] != own[2]);
    }
}
